//! Light probes of a bake: positions and output file.

use std::io::ErrorKind;

use atlas_bake::parse_points;
use gather::probes::{MAX_PROBES, ProbeGrid, ProbeOptions, ReflectionOptions};
use glam::{DVec3, Vec3};
use mesh_ingest::{Scene, Soup, check_regular, read_regular};

use crate::error::Error;
use crate::settings::{ProbeSource, Quality, Settings};

/// Longest probe list that is read, bytes: room for three full numbers and whitespace for each of
/// the maximum number of probes.
const MAX_BYTES: u64 = 256 * MAX_PROBES as u64;

/// Longest side of a volume texture in WebGPU and WebGL 2.
const LONGEST: u32 = 2048;

/// Positions of a bake's probes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ProbePlan {
    /// Positions in the glTF's world space, metres.
    pub positions: Vec<DVec3>,
    /// Their arrangement, if they form a grid.
    pub grid: Option<ProbeGrid>,
}

/// Like [`sky::check_file`](crate::sky::check_file), for a list of points. Also refuses a volume of
/// no probes.
///
/// # Errors
/// [`Error::Probes`], [`Error::Setting`].
pub(crate) fn check_file(settings: &Settings) -> Result<(), Error> {
    if settings.probe_volume && settings.probes.is_none() {
        return Err(Error::Setting(
            "--probe-volume without probes: expected --probes SPACING too".into(),
        ));
    }
    let Some(ProbeSource::File(path)) = &settings.probes else {
        return Ok(());
    };
    check_regular(path, MAX_BYTES).map_err(|e| Error::Probes {
        file: path.clone(),
        message: match e.kind() {
            ErrorKind::NotFound => format!("{e}; --probes takes a spacing in metres or a file"),
            _ => e.to_string(),
        },
        io: e.kind() != ErrorKind::FileTooLarge,
    })
}

/// Reads the list of points, if the source is one, before any expensive work.
///
/// # Errors
/// [`Error::Probes`] if the file cannot be read or is not a list of points; [`Error::Setting`] for
/// an invalid spacing.
pub(crate) fn read(source: &ProbeSource) -> Result<Vec<DVec3>, Error> {
    match source {
        ProbeSource::Spacing(s) if s.is_finite() && *s > 0.0 => Ok(Vec::new()),
        ProbeSource::Spacing(s) => Err(Error::Setting(format!(
            "the probe spacing is {s}, expected a number above 0"
        ))),
        ProbeSource::File(path) => {
            let fail = |message: String, io: bool| Error::Probes {
                file: path.to_owned(),
                message,
                io,
            };
            let bytes = read_regular(path, MAX_BYTES).map_err(|e| {
                let io = e.kind() != ErrorKind::FileTooLarge;
                fail(e.to_string(), io)
            })?;
            parse_points(&bytes).map_err(|e| fail(e.to_string(), false))
        }
    }
}

/// Plans the probes; `points` is the result of [`read`].
///
/// # Errors
/// [`Error::Setting`] if a grid would have too many, or if there is none for a `volume`.
pub(crate) fn plan(
    source: &ProbeSource,
    points: Vec<DVec3>,
    (scene, soup): (&Scene, &Soup),
    volume: bool,
) -> Result<ProbePlan, Error> {
    let ProbeSource::Spacing(spacing) = source else {
        if volume {
            return Err(Error::Setting(
                "--probe-volume needs a grid: expected --probes SPACING, found a list of points"
                    .into(),
            ));
        }
        return Ok(ProbePlan {
            positions: points,
            grid: None,
        });
    };
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for p in soup.triangles.iter().flatten() {
        low = low.min(*p);
        high = high.max(*p);
    }
    if soup.triangles.is_empty() {
        (low, high) = (Vec3::ZERO, Vec3::ZERO);
    }
    let place = |p: Vec3| p.as_dvec3() + scene.origin;
    // Uses the decimal number that was given instead of its `f32`, because positions are written in
    // full.
    let spacing = spacing.to_string().parse().unwrap_or(f64::from(*spacing));
    let grid = ProbeGrid::over(place(low), place(high), spacing)
        .map_err(|e| Error::Setting(e.to_string()))?;
    let [rx, ry, rz] = grid.dims;
    if volume && rx.max(2 * ry).max(3 * rz) > LONGEST {
        return Err(Error::Setting(format!(
            "--probe-volume: the grid is {rx} x {ry} x {rz}, expected at most {LONGEST} x {} x {} as graphics cards allow; choose a larger spacing",
            LONGEST / 2,
            LONGEST / 3
        )));
    }
    Ok(ProbePlan {
        positions: (0..grid.len()).map(|i| grid.position(i)).collect(),
        grid: Some(grid),
    })
}

/// Options of reflection captures of a quality.
pub(crate) fn reflection_options(quality: Quality) -> ReflectionOptions {
    let (size, rays) = match quality {
        Quality::Draft => (64, 4),
        Quality::Quick => (128, 8),
        Quality::Preview => (128, 16),
        Quality::Production => (256, 32),
    };
    ReflectionOptions { size, rays }
}

/// Probe options of a quality.
pub(crate) fn options(quality: Quality) -> ProbeOptions {
    let (rays, samples) = match quality {
        Quality::Draft => (256, 32),
        Quality::Quick => (512, 64),
        Quality::Preview => (1024, 128),
        Quality::Production => (4096, 512),
    };
    ProbeOptions { rays, samples }
}
