//! `lumel bake`.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use lumel::atlas_bake::OutputSet;
use lumel::{
    Monitor, Only, Order, Phase, Provenance, ReadFile, Rebaked, Remark, Report, Settings,
    WorkFolder,
};

use super::Failure;
use super::args::{Bake, BakeScenes};
use super::config::Layered;
use super::dry_run;
use super::interrupt;
use super::progress::Display;
use super::scenes;
use super::unchanged::{self, dependencies};

/// Size of the preview picture.
const PREVIEW: [u32; 2] = [1280, 720];

/// Small, because the first picture should appear at once.
const FIRST: [u32; 2] = [640, 360];

/// Outcome of one level.
#[derive(Debug)]
pub(crate) enum Done {
    /// The plan was printed.
    Planned,
    /// The results were up to date.
    Unchanged(Files),
    /// The level was baked, in this many seconds.
    Baked(Files, f64),
}

/// Files that one level's bake read and wrote.
#[derive(Debug, Default)]
pub(crate) struct Files {
    pub inputs: Vec<PathBuf>,
    pub outputs: Vec<PathBuf>,
    /// After a bake: inputs with their contents' hashes, missing files included.
    pub read: Vec<ReadFile>,
}

/// Bakes one level or several.
pub(crate) fn run(command: &BakeScenes) -> Result<(), Failure> {
    let a = &command.bake;
    let found = scenes::find(&command.scenes)?;
    use_threads(a.threads)?;
    // A dry run creates no folder that would have to be removed.
    let output = (!a.dry_run).then(|| a.output.clone());
    interrupt::under_control(output, || match &found[..] {
        [scene] => {
            let a = a.of(scene);
            one(&a, &a.settings()?).map(drop)
        }
        many => scenes::run(many, a),
    })
}

/// Limits the process to this many worker threads.
pub(crate) fn use_threads(threads: Option<usize>) -> Result<(), lumel::Error> {
    let Some(n) = threads else { return Ok(()) };
    if n == 0 || n > 1024 {
        let message = format!("--threads is {n}, expected 1 to 1024");
        return Err(lumel::Error::Setting(message));
    }
    // Fails only if a pool exists, and none does yet.
    let _ = rayon::ThreadPoolBuilder::new()
        .num_threads(n)
        .build_global();
    Ok(())
}

/// Bakes and writes the level `a.scene`, unless its results are up to date.
pub(crate) fn one(a: &Bake, layered: &Layered) -> Result<Done, Failure> {
    one_until(a, layered, &AtomicBool::new(false))
}

/// As [`one`], but ends with [`lumel::Error::Cancelled`] once `stop` is set.
pub(crate) fn one_until(a: &Bake, layered: &Layered, stop: &AtomicBool) -> Result<Done, Failure> {
    let Layered {
        settings,
        provenance,
        strict,
    } = layered;
    check_outputs(a, settings, provenance)?;
    let display = Display::new(a, settings, stop);
    if a.dry_run {
        dry_run::run(a, settings, provenance)?;
        return Ok(Done::Planned);
    }
    if a.skip_if_unchanged
        && let Some(files) = unchanged::skip(a, settings, provenance, *strict, &display)?
    {
        return Ok(Done::Unchanged(files));
    }
    let outcome = bake(a, settings, provenance, None, &display);
    conclude(a, outcome, *strict, &display)
}

/// Finishes a bake whose shards are all gathered.
pub(crate) fn merge(a: &Bake, layered: &Layered, work: &WorkFolder) -> Result<Done, Failure> {
    let (settings, provenance) = (&layered.settings, &layered.provenance);
    check_outputs(a, settings, provenance)?;
    let stop = AtomicBool::new(false);
    let display = Display::new(a, settings, &stop);
    let outcome = bake(a, settings, provenance, Some(work), &display);
    conclude(a, outcome, layered.strict, &display)
}

/// Prints what the user wants to know about the result.
fn conclude(
    a: &Bake,
    outcome: Result<Option<(Report, Files)>, Failure>,
    strict: bool,
    display: &Display<'_>,
) -> Result<Done, Failure> {
    display.finish();
    let Some((report, files)) = outcome? else {
        return unchanged::told(a, display);
    };
    for w in &report.warnings {
        display.warn(w);
    }
    summary(a, &report, display);
    if a.json {
        std::io::stdout().lock().write_all(&report.to_json())?;
    }
    if strict && !report.warnings.is_empty() {
        return Err(Failure::Strict(report.warnings.len()));
    }
    Ok(Done::Baked(files, report.measured.seconds))
}

/// Refuses, before any work, outputs that would replace the scene or each other.
fn check_outputs(
    a: &Bake,
    settings: &Settings,
    provenance: &Provenance,
) -> Result<(), lumel::Error> {
    let place = |path: &Path| -> PathBuf {
        let folder = match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        // A folder that does not exist contains nothing to replace.
        let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
        folder.join(path.file_name().unwrap_or_default())
    };
    let names = lumel::output_names(&a.scene, settings);
    let outputs: Vec<PathBuf> = names
        .iter()
        .map(|name| place(&a.output.join(name)))
        .collect();
    let own_report = outputs.last().cloned();
    if outputs.contains(&place(&a.scene)) {
        return Err(lumel::Error::Setting(format!(
            "{}: the bake would replace its own scene; choose another folder with -o",
            a.scene.display()
        )));
    }
    let points = match &settings.probes {
        Some(lumel::ProbeSource::File(path)) => Some(path),
        _ => None,
    };
    if let Some(path) = points.filter(|p| outputs.contains(&place(p))) {
        return Err(lumel::Error::Setting(format!(
            "{}: the bake would replace its own list of probes; choose another folder with -o",
            path.display()
        )));
    }
    let mut taken = outputs;
    taken.push(place(&a.scene));
    taken.extend(points.map(|p| place(p)));
    taken.extend(provenance.config.iter().map(|(path, _)| place(path)));
    // `--report` may name the report's usual place.
    let report = a
        .report
        .iter()
        .filter(|path| Some(place(path)) != own_report);
    for path in report
        .chain(&a.preview)
        .chain(&a.first_picture)
        .chain(&a.depfile)
    {
        let path = place(path);
        if taken.contains(&path) {
            return Err(lumel::Error::Setting(format!(
                "{}: this file is also an input or another output of the bake",
                path.display()
            )));
        }
        taken.push(path);
    }
    Ok(())
}

/// Every file that the bake may replace.
fn all_outputs(a: &Bake, settings: &Settings) -> Result<Vec<PathBuf>, lumel::Error> {
    let names = lumel::output_names(&a.scene, settings);
    let mut all = lumel::outputs_in(&a.output, &a.scene, &names)?;
    for path in [&a.report, &a.preview, &a.first_picture, &a.depfile] {
        all.extend(path.clone());
    }
    Ok(all)
}

/// Writes the first picture on its own and at once: it is not one of the results.
fn show_first(
    a: &Bake,
    png: &[u8],
    start: Instant,
    display: &Display<'_>,
) -> Result<(), lumel::Error> {
    let Some(path) = &a.first_picture else {
        return Ok(());
    };
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
    let mut set = OutputSet::create(folder.unwrap_or(Path::new(".")))?;
    set.add_path(path, png)?;
    interrupt::committing(|| set.commit())?;
    display.say(&format!(
        "  picture   {} after {:.2} s",
        path.display(),
        start.elapsed().as_secs_f64()
    ));
    Ok(())
}

fn bake(
    a: &Bake,
    settings: &Settings,
    provenance: &Provenance,
    work: Option<&WorkFolder>,
    display: &Display<'_>,
) -> Result<Option<(Report, Files)>, Failure> {
    // Created first, so that an unwritable folder does not cost a bake. It disappears again if
    // dropped without a commit.
    let mut set = OutputSet::create(&a.output)?;
    let left = set.leftovers();
    if left.files > 0 {
        display.say(&format!(
            "  removed   {} temporary files left by killed bakes, {:.1} MiB",
            left.files,
            left.bytes as f64 / f64::from(1 << 20)
        ));
    }
    let cache = a.cache.as_ref().map(|folder| lumel::Cache {
        folder: folder.clone(),
        limit: a.cache_size.unwrap_or(lumel::Cache::LIMIT),
    });
    let start = Instant::now();
    let outputs = all_outputs(a, settings)?;
    let show = |png: Vec<u8>| show_first(a, &png, start, display);
    let tell = |remark: Remark<'_>| match remark {
        Remark::Note(note) => display.say(&format!("note: {note}")),
        Remark::Warning(warning) => display.warn(warning),
    };
    let beside = lumel::Beside {
        cache: cache.as_ref(),
        first_picture: a.first_picture.as_ref().map(|_| lumel::FirstPicture {
            size: FIRST,
            show: &show,
        }),
        in_turn: a.in_turn,
        outputs: &outputs,
        tell: Some(&tell),
    };
    let order = Order {
        scene: &a.scene,
        settings,
        provenance,
    };
    let bake = match work {
        None if !a.only.is_empty() => {
            let (folder, names) = (&a.output, &a.only[..]);
            match lumel::rebake(order, &Only { folder, names }, &beside, display)? {
                Rebaked::Current => return Ok(None),
                Rebaked::Done(bake) => *bake,
            }
        }
        None => lumel::bake_beside(&a.scene, settings, provenance, &beside, display)?,
        Some(work) => lumel::merge_work(order, work, &beside, display)?,
    };
    if let Some(cache) = &bake.report.measured.cache {
        say_cache(cache, display);
    }
    if let Some(lods) = lumel::describe_lods(&bake.report.ingest.lods) {
        display.say(&format!("  lods      {lods}"));
    }
    if let Some(culled) = &bake.report.culled {
        display.say(&format!(
            "  culled    {:.0} % of the surface, seen from none of {} points ({}); {} nodes have no lumels",
            100.0 * culled.area,
            culled.points,
            culled.from,
            culled.nodes.len()
        ));
    }
    if let Some(only) = &bake.report.only {
        display.say(&format!(
            "  only      {} nodes baked anew, {} keep their light",
            only.nodes.len(),
            only.kept_nodes
        ));
    }
    let layout = &bake.report.layout;
    let pages = layout.describe_pages();
    display.say(&format!(
        "  lightmap  {:.4} texels per unit, {} lumels, pages {}",
        layout.texels_per_unit,
        bake.report.gather.light.lumels,
        pages.join(", ")
    ));
    let seams = &bake.report.gather.seams;
    if a.verbose && seams.samples > 0 {
        display.say(&format!(
            "  seams     {:.1} m, 99 % of it within {:.2} % (before stitching {:.2} %)",
            seams.metres,
            100.0 * seams.after.p99,
            100.0 * seams.before.p99
        ));
    }
    if let Some(p) = &bake.report.probes {
        display.say(&format!(
            "  probes    {}, {} of them inside or behind geometry",
            p.probes, p.invalid
        ));
    }
    if let Some(r) = &bake.report.reflections {
        display.say(&format!(
            "  captures  {} of reflections, {} of them inside or behind geometry",
            r.captures, r.invalid
        ));
    }
    display.progress(Phase::Write, 0, 0);
    let preview = match &a.preview {
        Some(path) => Some((path, bake.preview(PREVIEW)?)),
        None => None,
    };
    let (files, report) = bake.files_beside(preview.as_ref().map(|(_, bytes)| &bytes[..]))?;
    for page in &report.ktx2 {
        display.say(&format!(
            "  ktx2      {}: compression error {:.2} % root mean square, {:.1} % at the 99th percentile, {} KiB",
            page.file,
            100.0 * page.stored.error.rel_rmse,
            100.0 * page.stored.error.p99,
            page.stored.bytes.div_ceil(1024)
        ));
    }
    for page in &report.png {
        display.say(&format!(
            "  png       {}: error {:.2} % root mean square, {:.1} % at the 99th percentile, {} KiB",
            page.file,
            100.0 * page.stored.error.rel_rmse,
            100.0 * page.stored.error.p99,
            page.stored.bytes.div_ceil(1024)
        ));
    }
    if settings.ktx2 == Some(lumel::Ktx2Format::Bc6h) && !settings.block_charts {
        // Not a warning: on the project's own levels this loss is at most a tenth of the error
        // above, and separate blocks cost up to a tenth of the page.
        display.say("            charts share 4 x 4 texel blocks; --block-charts separates them");
    }
    if display.cancelled() {
        return Err(lumel::Error::Cancelled.into());
    }
    for (name, bytes) in &files {
        set.add(name, bytes)?;
        if display.cancelled() {
            return Err(lumel::Error::Cancelled.into());
        }
    }
    if let Some(path) = &a.report {
        set.add_path(path, &report.to_json())?;
    }
    if let Some((path, bytes)) = preview {
        set.add_path(path, &bytes)?;
    }
    let made = Files {
        inputs: bake.input_paths(settings, provenance),
        outputs: set.paths().map(Path::to_owned).collect(),
        read: bake.files_read(settings, provenance),
    };
    if let Some(path) = a.own_depfile() {
        set.add_path(path, &dependencies(a, &made)?)?;
    }
    bake.retire_pages(&mut set);
    let done = interrupt::committing(|| set.commit())?;
    if a.verbose {
        for path in &done.written {
            display.say(&format!("  wrote     {}", path.display()));
        }
        for path in &done.unchanged {
            display.say(&format!("  unchanged {}", path.display()));
        }
        for path in &done.removed {
            display.say(&format!("  removed   {}", path.display()));
        }
    }
    Ok(Some((report, made)))
}

fn say_cache(cache: &lumel::CacheReport, display: &Display<'_>) {
    let [found, kept] = cache.charts;
    if found + kept > 0 {
        display.say(&format!(
            "  cache     charts of {found} meshes reused, of {kept} stored"
        ));
    }
    for note in &cache.notes {
        display.say(&format!("  cache     {note}"));
    }
}

fn summary(a: &Bake, report: &Report, display: &Display<'_>) {
    if a.verbose {
        details(report, display);
    }
    let out = a.output.display();
    let light = &report.gather.light;
    let error = if light.estimated_error.is_finite() {
        format!(
            "estimated error {:.2} % (median; {:.1} % root mean square)",
            100.0 * light.median_error,
            100.0 * light.estimated_error
        )
    } else {
        "no error estimate: no lumel receives light".into()
    };
    display.say(&format!(
        "baked {} in {:.2} s, {error}: {out}",
        report.scene, report.measured.seconds
    ));
    if !a.one_of_many {
        display.say(&format!("view it with: lumel view {out}"));
    }
}

/// Figures for readers who know Lumel's internals.
fn details(report: &Report, display: &Display<'_>) {
    let m = &report.measured;
    let audit = &report.solve.audit;
    display.say(&format!(
        "  solve     {} patches, {} elements, {} rays per patch, {} sweeps, {} iterations, row sums {:.4} mean, {:.4} min",
        report.solve.subdivision.patches,
        report.solve.subdivision.elements,
        report.solve.rays_per_patch,
        report.solve.relaxation.sweeps,
        report.solve.relaxation.iterations,
        audit.row_sum_mean,
        audit.row_sum_min,
    ));
    display.say(&format!(
        "  energy    emitted {:.4}, absorbed {:.4}, lost on backfaces {:.4}, escaped {:.4} (sum of RGB), imbalance {:.3} % (bound {:.3} %)",
        audit.flux_emitted.iter().sum::<f64>(),
        audit.flux_absorbed.iter().sum::<f64>(),
        audit.flux_behind.iter().sum::<f64>(),
        audit.flux_escaped.iter().sum::<f64>(),
        100.0 * audit.imbalance,
        100.0 * audit.bound
    ));
    if let Some(v) = report.gather.vertices.filter(|v| v.points > 0) {
        let added = match v.added {
            0 => String::new(),
            n => format!(", {n} added by splitting"),
        };
        // The high percentiles come from single triangles that span light and dark; only the report
        // lists them.
        display.say(&format!(
            "  vertices  {} with separate colours{added}; half of them within {:.1} % of the lightmap",
            v.points,
            100.0 * v.difference.median,
        ));
    }
    let peak = m
        .peak_bytes
        .map(|b| format!(", {} MiB", b >> 20))
        .unwrap_or_default();
    display.say(&format!("  rays      {:.1} M/s{peak}", m.mrays_per_second));
}
