//! `lumel bake --dry-run`.

use std::io::Write;

use lumel::{Provenance, Settings};

use super::args::Bake;
use super::progress::duration;
use super::{Failure, config, interrupt};

/// Prints the plan; writes nothing.
pub(crate) fn run(a: &Bake, settings: &Settings, provenance: &Provenance) -> Result<(), Failure> {
    let e = lumel::estimate(&a.scene, settings, &interrupt::Cancel)?;
    let mut out = std::io::stdout().lock();
    if a.json {
        let v = serde_json::json!({
            "estimate": e,
            "settings": settings,
            "origins": provenance.origins,
        });
        writeln!(out, "{v:#}")?;
        return Ok(());
    }
    let pages = e.layout.describe_pages();
    writeln!(out, "scene     {}, {} triangles", e.scene, e.triangles)?;
    let path =
        (provenance.config.as_ref()).map_or("no file".into(), |(p, _)| p.display().to_string());
    writeln!(out, "settings  {path}")?;
    writeln!(out, "          {}", config::describe(&provenance.origins))?;
    writeln!(
        out,
        "lightmap  {:.4} texels per unit, {:.0} lumels in {} charts, pages {}",
        e.layout.texels_per_unit,
        e.layout.lumels,
        e.layout.charts,
        pages.join(", ")
    )?;
    if e.probes > 0 {
        writeln!(out, "probes    {}", e.probes)?;
    }
    if e.reflections > 0 {
        writeln!(out, "captures  {} of reflections", e.reflections)?;
    }
    writeln!(
        out,
        "writes    {} into {}",
        e.files.join(", "),
        a.output.display()
    )?;
    if e.planned_twice {
        let why = "light differs on both sides of thin walls, sheets or edges of shadows";
        writeln!(out, "charts    planned twice: {why}")?;
    }
    writeln!(
        out,
        "cost      about {} (within a factor of {}), {:.0} MiB, {:.1} M rays",
        duration(e.seconds),
        lumel::ESTIMATE_FACTOR,
        e.bytes / f64::from(1 << 20),
        1e-6 * e.rays,
    )?;
    for w in &e.layout.warnings {
        writeln!(out, "warning   {w}")?;
    }
    Ok(())
}
