//! Converts a raw primitive to the normal form: makes numbers finite and removes degenerate faces.

use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::accessor::{DataType, RawAccessor};
use crate::document::Document;
use crate::error::Outcome;
use crate::json::Item;
use crate::options::MAX_COORDINATE;
use crate::primitive::{Mode, RawPrimitive, TEX_COORD_SETS, Want, primitive_mode};
use crate::report::IngestReport;
use crate::scene::Primitive;

/// Smallest ratio of twice a triangle's area to the square of its longest edge; below it counts as
/// zero area.
///
/// Double rounding leaves about 1e-15 for exactly collinear corners. The thinnest triangle of `f32`
/// corners with similar magnitudes has about 1e-7, and slivers of aspect ratio 1e6 must survive.
/// 1e-12 is a factor of a thousand above the noise.
pub(crate) const MIN_ASPECT: f64 = 1e-12;

/// Twice-area vector of a triangle, or `None` if it has no area.
pub(crate) fn area_vector(a: DVec3, b: DVec3, c: DVec3) -> Option<DVec3> {
    let (ab, ac, bc) = (b - a, c - a, c - b);
    let normal = ab.cross(ac);
    let longest = ab
        .length_squared()
        .max(ac.length_squared())
        .max(bc.length_squared());
    (normal.length() > MIN_ASPECT * longest).then_some(normal)
}

/// Reads and cleans one primitive; `None` if nothing remains. `double_sided` is its material's.
pub(crate) fn read(
    document: &Document,
    item: &Item<'_>,
    gltf_primitive: usize,
    material: usize,
    double_sided: bool,
    report: &mut IngestReport,
) -> Outcome<Option<Primitive>> {
    match primitive_mode(item)? {
        Mode::Points => {
            report.count("primitives.points", 1);
            return Ok(None);
        }
        Mode::Lines | Mode::LineLoop | Mode::LineStrip => {
            report.count("primitives.lines", 1);
            return Ok(None);
        }
        Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan => {}
    }
    let raw = document.read_primitive(item, Want::Light)?;
    let Some(positions) = raw.attribute("POSITION") else {
        report.warn(
            item.path_of("attributes"),
            "no POSITION, so there is nothing to bake",
        );
        report.count("primitives.no_position", 1);
        return Ok(None);
    };
    let (positions, bad) = positions_of(positions);
    let bad_vertices = bad.iter().filter(|&&b| b).count() as u64;
    report.count("vertices.non_finite", bad_vertices);
    if bad_vertices > 0 {
        report.warn(
            item.path_of("attributes.POSITION"),
            format!("{bad_vertices} positions are not finite; their triangles are dropped"),
        );
    }
    let (triangles, source_triangles) =
        clean(&raw.triangles, &positions, &bad, double_sided, report);
    if triangles.is_empty() {
        report.count("primitives.empty", 1);
        report.warn(&item.path, "no triangle has any area");
        return Ok(None);
    }
    let normals = raw
        .attribute("NORMAL")
        .map(|n| normals_of(n, &positions, &triangles, report))
        .unwrap_or_default();
    let colors = raw
        .attribute("COLOR_0")
        .map(|c| colors_of(c, report))
        .unwrap_or_default();
    let tex_coords = tex_coords_of(&raw, report);
    Ok(Some(Primitive {
        gltf_primitive,
        positions,
        normals,
        tex_coords,
        colors,
        triangles,
        source_triangles,
        material,
    }))
}

/// Positions, with unusable ones set to zero, and a mask of the unusable ones.
fn positions_of(raw: &RawAccessor<'_>) -> (Vec<Vec3>, Vec<bool>) {
    let mut positions: Vec<Vec3> = raw
        .to_floats::<3>(0.0)
        .into_iter()
        .map(Vec3::from)
        .collect();
    let bad: Vec<bool> = positions
        .iter()
        // Written so that NaN fails it.
        .map(|p| !(f64::from(p.abs().max_element()) <= MAX_COORDINATE && p.is_finite()))
        .collect();
    for (p, &bad) in positions.iter_mut().zip(&bad) {
        if bad {
            *p = Vec3::ZERO;
        }
    }
    (positions, bad)
}

/// Drops triangles that repeat a vertex, have unusable corners or no area, or duplicate another
/// triangle.
fn clean(
    all: &[[u32; 3]],
    positions: &[Vec3],
    bad: &[bool],
    double_sided: bool,
    report: &mut IngestReport,
) -> (Vec<[u32; 3]>, Vec<u32>) {
    let (mut repeated, mut non_finite, mut flat) = (0, 0, 0);
    let mut kept = Vec::with_capacity(all.len());
    for (number, &[a, b, c]) in all.iter().enumerate() {
        let corner = |i: u32| positions[i as usize].as_dvec3();
        if [a, b, c].iter().any(|&i| bad[i as usize]) {
            non_finite += 1;
        } else if a == b || b == c || a == c {
            repeated += 1;
        } else if area_vector(corner(a), corner(b), corner(c)).is_none() {
            flat += 1;
        } else {
            kept.push((canonical([a, b, c], double_sided), number as u32));
        }
    }
    report.count("triangles.repeated_vertex", repeated);
    report.count("triangles.non_finite", non_finite);
    report.count("triangles.zero_area", flat);
    // Sorting groups equal triangles; the lowest index of each group is kept.
    let clean = kept.len();
    kept.sort_unstable();
    kept.dedup_by_key(|(key, _)| *key);
    report.count("triangles.duplicate", (clean - kept.len()) as u64);
    let mut numbers: Vec<u32> = kept.into_iter().map(|(_, number)| number).collect();
    numbers.sort_unstable();
    (numbers.iter().map(|&n| all[n as usize]).collect(), numbers)
}

/// The same for all rotations of a triangle, and for both windings if facing does not matter.
fn canonical(mut triangle: [u32; 3], both_windings: bool) -> [u32; 3] {
    if both_windings {
        triangle.sort_unstable();
    } else {
        let least = (0..3).min_by_key(|&k| triangle[k]).unwrap_or(0);
        triangle.rotate_left(least);
    }
    triangle
}

/// Unit normals; unusable ones are replaced by the mean of the adjacent faces'.
fn normals_of(
    raw: &RawAccessor<'_>,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    report: &mut IngestReport,
) -> Vec<Vec3> {
    /// Relative length error beyond which a normal counts as repaired; signed bytes have errors of
    /// 1/127 per component.
    const UNIT: f64 = 0.02;
    let (mut replaced, mut scaled) = (Vec::new(), 0);
    let mut normals: Vec<Vec3> = Vec::with_capacity(raw.count);
    for (i, n) in raw.to_floats::<3>(0.0).into_iter().enumerate() {
        let n = Vec3::from(n).as_dvec3();
        let length = n.length();
        if length.is_finite() && length > 0.0 {
            scaled += u64::from((length - 1.0).abs() > UNIT);
            normals.push((n / length).as_vec3());
        } else {
            replaced.push(i);
            normals.push(Vec3::ZERO);
        }
    }
    report.count("normals.normalised", scaled);
    report.count("normals.replaced", replaced.len() as u64);
    if replaced.is_empty() {
        return normals;
    }
    let mut sums = vec![DVec3::ZERO; normals.len()];
    for t in triangles {
        let [a, b, c] = t.map(|i| positions[i as usize].as_dvec3());
        for &i in t {
            sums[i as usize] += (b - a).cross(c - a);
        }
    }
    for i in replaced {
        // The normal of an unused vertex is arbitrary.
        normals[i] = sums[i].try_normalize().unwrap_or(DVec3::Y).as_vec3();
    }
    normals
}

/// Linear RGBA in 0..=1.
fn colors_of(raw: &RawAccessor<'_>, report: &mut IngestReport) -> Vec<Vec4> {
    // Integer colours mean 0..=1 in every known file, whether or not the exporter set the
    // `normalized` flag that the specification requires.
    let raw = RawAccessor {
        normalized: raw.component != DataType::F32,
        ..raw.clone()
    };
    let (mut replaced, mut clamped) = (0, 0);
    let colors = raw
        .to_floats::<4>(1.0)
        .into_iter()
        .map(|c| {
            let color = Vec4::from(c);
            if !color.is_finite() {
                replaced += 1;
                return Vec4::ONE;
            }
            let inside = color.clamp(Vec4::ZERO, Vec4::ONE);
            clamped += u64::from(inside != color);
            inside
        })
        .collect();
    report.count("colors.replaced", replaced);
    report.count("colors.clamped", clamped);
    colors
}

fn tex_coords_of(raw: &RawPrimitive<'_>, report: &mut IngestReport) -> Vec<Vec<Vec2>> {
    let mut sets: Vec<Vec<Vec2>> = Vec::new();
    let mut replaced = 0;
    for n in 0..TEX_COORD_SETS {
        let Some(accessor) = raw.attribute(&format!("TEXCOORD_{n}")) else {
            continue;
        };
        sets.resize(n + 1, Vec::new());
        sets[n] = accessor
            .to_floats::<2>(0.0)
            .into_iter()
            .map(|uv| {
                let uv = Vec2::from(uv);
                if uv.is_finite() {
                    return uv;
                }
                replaced += 1;
                Vec2::ZERO
            })
            .collect();
    }
    report.count("tex_coords.replaced", replaced);
    sets
}
