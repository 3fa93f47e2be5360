//! From a level to its charts and its light on patches.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use atlas::{KeptCharts, Layout, LayoutError, LayoutOptions, LayoutProgress, LayoutReport};
use atlas_bake::{
    BakeOptions, Baked, Counts, Earlier, LitScene, MixedLight, PictureLight, choose_camera,
    render_preview, scene_camera,
};
use gather::Records;
use mesh_ingest::{Loaded, Scene, Soup};
use radiosity::{
    Bounce, DirectLight, Emitters, Monitor, Phase, Sky, Solution, World, WorldOptions,
};

use crate::beside::{Beside, FirstPicture};
use crate::cache::{CacheReport, Charts};
use crate::clock::{Clock, begin};
use crate::cut;
use crate::error::Error;
use crate::memory::Need;
use crate::mixed;
use crate::open::{Changes, Opened, Outside, Solved, Uncut};
use crate::settings::Settings;
use crate::split;

/// Charts of a level, and its light on patches.
pub(crate) struct Planned<'l> {
    pub layout: Layout,
    pub report: LayoutReport,
    pub lit: Lit<'l>,
    /// Lamps left out of the pages, and warnings about them.
    pub mixed: Option<(MixedLight, Vec<String>)>,
    /// What the cache did.
    pub cached: Option<CacheReport>,
}

impl Planned<'_> {
    pub(crate) fn into_solution(self) -> Solution {
        self.lit.solution
    }
}

impl Changes {
    /// The changes that the light asks for.
    pub(crate) fn wanted(
        loaded: &Loaded,
        (world, emitters, solution): (&World<'_>, &Emitters, &Solution),
        report: &LayoutReport,
        settings: &Settings,
    ) -> Changes {
        Changes {
            split: match settings.split_sides {
                true => split::wanted(loaded, world, solution),
                false => BTreeSet::new(),
            },
            cuts: match settings.cut_charts {
                true => cut::wanted(loaded, (world, emitters, solution), report),
                false => Vec::new(),
            },
        }
    }
}

impl Opened {
    /// Bakes no light probes: those of an earlier bake stay.
    pub(crate) fn leave_probes(&mut self) {
        self.probes = None;
    }

    /// Changes of the document that the light asks for, unless they were made before.
    pub(crate) fn to_change(&self, planned: &Planned<'_>, settings: &Settings) -> Changes {
        if self.decided {
            return Changes::default();
        }
        Changes::wanted(&self.loaded, planned.lit.parts(), &planned.report, settings)
    }

    /// The light of a document whose charts are to be cut.
    ///
    /// # Errors
    /// [`Error`], by fault.
    pub(crate) fn uncut(
        self,
        file: &Path,
        outside: Outside,
        settings: &Settings,
        monitor: &dyn Monitor,
    ) -> Result<Box<Uncut>, Error> {
        let level = Level {
            file,
            loaded: &self.loaded,
            soup: &self.soup,
            settings,
            first_picture: None,
        };
        let mut clock = self.clock.clone();
        let solution = level.light(outside, monitor, &mut clock)?.solution;
        Ok(Box::new(Uncut {
            soup: self.soup,
            solution,
        }))
    }

    /// Makes charts and solves the light, unless that is known.
    ///
    /// # Errors
    /// [`Error`], by fault.
    pub(crate) fn plan<'l>(
        &'l self,
        file: &'l Path,
        outside: Outside,
        settings: &'l Settings,
        beside: &'l Beside<'l>,
        (clock, monitor): (&mut Clock, &dyn Monitor),
    ) -> Result<Planned<'l>, Error> {
        begin(monitor, Phase::Atlas)?;
        let charts = beside.cache.map(Charts::new);
        let kept: &dyn KeptCharts = match &charts {
            Some(charts) => charts,
            None => &self.charts,
        };
        let level = Level {
            file,
            loaded: &self.loaded,
            soup: &self.soup,
            settings,
            first_picture: beside.first_picture.as_ref(),
        };
        // With a single thread, concurrency would only alternate between the two.
        let bounded = settings.bounds.memory.is_some() || Need::might_exceed(&self.soup, settings);
        let in_turn = beside.in_turn || bounded || rayon::current_num_threads() == 1;
        let ((layout, report), mut lit) = if in_turn {
            let planned = level.charts(Some(kept), monitor)?;
            if bounded {
                level.check_memory(&planned, &outside.sky)?;
            }
            clock.lap(Phase::Atlas);
            (planned, level.light(outside, monitor, clock)?)
        } else {
            level.charts_and_light(Some(kept), outside, monitor, clock)?
        };
        let (world, emitters, solution) = lit.parts();
        let settled = mixed::settle(world, emitters, solution, &self.modes, settings);
        let mixed = settled.map(|mixed| {
            lit.world.roles = Some(mixed.roles);
            (mixed.light, mixed.warnings)
        });
        Ok(Planned {
            layout,
            report,
            lit,
            mixed,
            cached: charts.map(Charts::close),
        })
    }
}

/// An opened level with its settings.
struct Level<'l> {
    file: &'l Path,
    loaded: &'l Loaded,
    soup: &'l Soup,
    settings: &'l Settings,
    first_picture: Option<&'l FirstPicture<'l>>,
}

impl<'l> Level<'l> {
    fn charts(
        &self,
        kept: Option<&dyn KeptCharts>,
        monitor: &dyn Monitor,
    ) -> Result<(Layout, LayoutReport), Error> {
        let scene = &self.loaded.scene;
        plan_layout(self.file, scene, self.soup, self.settings, kept, monitor)
    }

    /// Refuses, before light is computed, a bake that needs more memory than allowed.
    fn check_memory(&self, planned: &(Layout, LayoutReport), sky: &Sky) -> Result<(), Error> {
        let (layout, report) = planned;
        let world = World::build(&self.loaded.scene, self.soup, WorldOptions::default())
            .map_err(|e| Error::Internal(format!("the tree cannot be built: {e}")))?;
        // Far too many lumels would take minutes to count.
        let counts = match Need::exceeds_by_far(report, self.settings) {
            true => Counts {
                lumels: report.lumels as usize,
                ..Counts::default()
            },
            false => Counts::of(&world, layout),
        };
        let need = Need::of(self.loaded, (&world, sky), self.settings, report, counts);
        need.check(self.settings, report)
    }

    /// Builds the tree, solves the light, and shows the first picture.
    fn light(
        &self,
        outside: Outside,
        monitor: &dyn Monitor,
        clock: &mut Clock,
    ) -> Result<Lit<'l>, Error> {
        begin(monitor, Phase::Tree)?;
        let Outside {
            sky,
            groups,
            solved,
        } = outside;
        let options = WorldOptions {
            sky,
            groups,
            bounce: bounce(self.settings),
            ..WorldOptions::default()
        };
        let world = World::build(&self.loaded.scene, self.soup, options)
            .map_err(|e| Error::Internal(format!("the tree cannot be built: {e}")))?;
        let emitters = Emitters::collect(&world);
        clock.lap(Phase::Tree);

        begin(monitor, Phase::Solve)?;
        let options = self.settings.solve_options(self.soup);
        let solve = || radiosity::solve(&world, &emitters, &options, monitor);
        let mut carried = false;
        let solution = match solved {
            None => solve(),
            Some(Solved::Uncut(light)) => {
                let Uncut { soup, solution } = *light;
                let known = solution.carried(&soup, &world);
                carried = known.is_some();
                known.unwrap_or_else(solve)
            }
            Some(Solved::Elsewhere { light, file }) => {
                let message = "found the light of other patches than the scene has";
                let other = || Error::Folder {
                    path: file,
                    message: message.into(),
                    io: false,
                };
                light.restore(&world, &options).ok_or_else(other)?
            }
        };
        if solution.report.cancelled {
            return Err(Error::Cancelled);
        }
        clock.lap(Phase::Solve);
        if let Some(first) = self.first_picture {
            let png = first_picture(self.loaded, &world, &emitters, &solution, first.size)?;
            (first.show)(png)?;
            clock.lap(Phase::Picture);
        }
        Ok(Lit {
            world,
            emitters,
            solution,
            carried,
        })
    }

    /// Makes charts and solves light concurrently: they do not depend on each other, and charting a
    /// few large meshes occupies only one core. If both fail, the charts' error is reported, as in
    /// sequence.
    fn charts_and_light(
        &self,
        kept: Option<&dyn KeptCharts>,
        outside: Outside,
        monitor: &dyn Monitor,
        clock: &mut Clock,
    ) -> Result<((Layout, LayoutReport), Lit<'l>), Error> {
        let (always, stop, planned) = (
            AtomicBool::new(true),
            AtomicBool::new(false),
            AtomicBool::new(false),
        );
        let side = |shown| Side {
            monitor,
            stop: &stop,
            shown,
        };
        let mut own = clock.clone();
        let (charts, lit) = rayon::join(
            || {
                let charts = self.charts(kept, &side(&always));
                clock.lap(Phase::Atlas);
                planned.store(true, Ordering::Relaxed);
                stop.fetch_or(charts.is_err(), Ordering::Relaxed);
                charts
            },
            || {
                own.phases.clear();
                let lit = self.light(outside, &side(&planned), &mut own);
                stop.fetch_or(lit.is_err(), Ordering::Relaxed);
                lit
            },
        );
        let outcome = match (charts, lit) {
            // The other side failed and cancelled this one.
            (Err(Error::Cancelled), Err(e)) => Err(e),
            (Err(e), _) | (_, Err(e)) => Err(e),
            (Ok(charts), Ok(lit)) => Ok((charts, lit)),
        }?;
        // Monitors see every phase in order.
        begin(monitor, Phase::Solve)?;
        clock.phases.append(&mut own.phases);
        clock.last = Instant::now();
        Ok(outcome)
    }
}

/// Light that other processes have computed.
#[derive(Clone, Copy)]
pub(crate) enum Done<'e> {
    /// That of shards.
    Shards(&'e dyn Records),
    /// That of nodes which are not baked anew.
    Earlier(&'e Earlier),
}

/// A level with a solution on patches.
pub(crate) struct Lit<'l> {
    pub world: World<'l>,
    pub emitters: Emitters,
    pub solution: Solution,
    /// Whether the solution is that of the document before its charts were cut.
    pub carried: bool,
}

impl Lit<'_> {
    /// The parts that the gather reads.
    pub(crate) fn parts(&self) -> (&World<'_>, &Emitters, &Solution) {
        (&self.world, &self.emitters, &self.solution)
    }

    pub(crate) fn bake(
        &self,
        layout: &Layout,
        settings: &Settings,
        monitor: &dyn Monitor,
    ) -> Result<Baked, Error> {
        let (world, emitters, solution) = self.parts();
        let options = bake_options(settings);
        atlas_bake::bake(world, emitters, solution, layout, &options, monitor)
            .map_err(|_| Error::Cancelled)
    }

    /// Bakes what others have not done.
    pub(crate) fn rest(
        &self,
        layout: &Layout,
        settings: &Settings,
        done: Done<'_>,
        monitor: &dyn Monitor,
    ) -> Result<Baked, Error> {
        let (parts, options) = (self.parts(), bake_options(settings));
        let baked = match done {
            Done::Shards(records) => atlas_bake::merge(parts, layout, &options, records, monitor),
            Done::Earlier(earlier) => atlas_bake::rebake(parts, layout, &options, earlier, monitor),
        };
        baked.map_err(|_| Error::Cancelled)
    }
}

/// The monitor of one of two concurrent tasks.
struct Side<'m> {
    monitor: &'m dyn Monitor,
    /// Set when the other task failed.
    stop: &'m AtomicBool,
    /// Whether this task's progress is shown.
    shown: &'m AtomicBool,
}

impl Monitor for Side<'_> {
    fn progress(&self, phase: Phase, done: u64, total: u64) {
        if self.shown.load(Ordering::Relaxed) {
            self.monitor.progress(phase, done, total);
        }
    }

    fn residual(&self, residual: f64) {
        if self.shown.load(Ordering::Relaxed) {
            self.monitor.residual(residual);
        }
    }

    fn cancelled(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.monitor.cancelled()
    }
}

/// The settings' changes to bounced light.
fn bounce(settings: &Settings) -> Bounce {
    let changed = &settings.not_physical;
    Bounce {
        albedo: changed.albedo_boost,
        saturation: changed.bounce_saturation,
        reflected: changed.indirect_boost,
    }
}

/// Gathering and page options from the settings.
pub(crate) fn bake_options(settings: &Settings) -> BakeOptions {
    BakeOptions {
        lumels: settings.lumel_options(),
        vertices: settings.vertex_colors.then(|| settings.vertex_options()),
        layers: settings.layers.clone(),
        padding: settings.padding,
        value: settings.value,
        directional: settings.directional,
        ao_distance: settings.ao_distance,
        hidden: settings.hidden,
        stitch: settings.stitch,
        error: settings.error,
        vertex_error: settings.vertex_error,
        ambient_floor: settings.not_physical.ambient_floor,
        ao_multiply: settings.not_physical.ao_multiply,
    }
}

/// The level lit by the solution on patches, as a PNG.
fn first_picture(
    loaded: &Loaded,
    world: &World,
    emitters: &Emitters,
    solution: &Solution,
    size: [u32; 2],
) -> Result<Vec<u8>, Error> {
    let lights = DirectLight::new(world, emitters).on_patches(&solution.cut);
    let lit = LitScene {
        scene: world.scene,
        soup: world.soup,
        bvh: world.tree(),
        light: PictureLight::Solved {
            world,
            solution,
            lights: &lights,
        },
    };
    let camera = scene_camera(&loaded.document, world.scene).unwrap_or_else(|| choose_camera(&lit));
    Ok(render_preview(&lit, &camera, size)?)
}

/// Plans charts and pages of a scene and reports progress.
pub(crate) fn plan_layout(
    file: &Path,
    scene: &Scene,
    soup: &Soup,
    settings: &Settings,
    kept: Option<&dyn KeptCharts>,
    monitor: &dyn Monitor,
) -> Result<(Layout, LayoutReport), Error> {
    let options = LayoutOptions {
        texels_per_unit: settings.texels_per_unit,
        max_page: settings.max_page,
        padding: settings.padding,
        block: settings.block,
        block_charts: settings.block_charts,
        uv_mode: settings.uv,
        unwrapper: settings.unwrapper,
        ..LayoutOptions::default()
    };
    let progress = |p: LayoutProgress| {
        monitor.progress(Phase::Atlas, p.done as u64, p.total as u64);
        !monitor.cancelled()
    };
    atlas::layout_kept(scene, soup, &options, kept, &progress).map_err(|source| match source {
        LayoutError::Cancelled => Error::Cancelled,
        source => Error::Layout {
            file: file.to_owned(),
            source,
        },
    })
}
