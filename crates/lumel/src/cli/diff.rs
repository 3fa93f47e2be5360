//! `lumel diff`.

use std::io::Write;

use lumel::atlas_bake::{OutputSet, diff, error_png, read_exr};

use super::Failure;
use super::args::Diff;

pub(crate) fn run(a: &Diff) -> Result<(), Failure> {
    let (reference, map) = (read_exr(&a.a)?, read_exr(&a.b)?);
    let report = diff(&reference, &map).map_err(|source| lumel::Error::Compare {
        a: a.a.clone(),
        b: a.b.clone(),
        source,
    })?;
    if let Some(path) = &a.picture {
        let png = error_png(&reference, &map)?;
        let parent = match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p.to_owned(),
            _ => ".".into(),
        };
        let mut set = OutputSet::create(&parent)?;
        set.add_path(path, &png)?;
        set.commit()?;
    }
    let mut out = std::io::stdout().lock();
    if a.json {
        writeln!(
            out,
            "{}",
            serde_json::to_string(&report).unwrap_or_default()
        )?;
        return Ok(());
    }
    let percent = |x: f64| format!("{:.4} %", 100.0 * x);
    writeln!(out, "lumels    {}", report.lumels)?;
    writeln!(
        out,
        "relRMSE   {} (lit lumels {})",
        percent(report.rel_rmse),
        percent(report.rel_rmse_lit)
    )?;
    writeln!(out, "nRMSE     {}", percent(report.n_rmse))?;
    writeln!(out, "bias      {}", percent(report.bias))?;
    writeln!(
        out,
        "p50 p95 p99  {}  {}  {}",
        percent(report.p50),
        percent(report.p95),
        percent(report.p99)
    )?;
    writeln!(
        out,
        "max       {} at column {}, row {}",
        percent(report.max),
        report.max_at[0],
        report.max_at[1]
    )?;
    if report.non_finite > 0 {
        writeln!(
            out,
            "skipped   {} lumels that are not finite",
            report.non_finite
        )?;
    }
    Ok(())
}
