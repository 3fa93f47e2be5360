//! xatlas (2019, through the `xatlas-rs` crate) as an [`Unwrapper`]; Lumel packs its charts.
//!
//! The crate's own bindings use MSVC-mangled names and do not link elsewhere, so the few required
//! functions are declared here. This file contains all `unsafe` code of the crate.
//!
//! xatlas cannot be cancelled, so it runs in its own thread. When its result is no longer needed,
//! the progress callback parks that thread forever, and its memory leaks. Time grows with the
//! square of a chart's triangles and of the number of charts, so it gets at most [`PIECES`] pieces
//! of at most [`PIECE`] triangles; only counts decide, never a clock. xatlas's scheduler can lose
//! the wake-up of a worker that is about to sleep: destroying an atlas hung about once in a
//! thousand runs, so the result is handed over first.
//!
//! xatlas prints warnings to stdout unless silenced, ignores triangles below 1.2e-7 square units
//! (so the mesh is scaled up), may mirror charts, and does not scale conformal charts to their true
//! area. Lumel's packing corrects the last two and replaces charts that overlap themselves.

use std::ffi::{c_int, c_void};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use glam::{Vec2, Vec3};
// Links the C++ library that the crate builds; the crate's Rust code is not used.
use xatlas_rs as _;

use super::finish::finish;
use super::input::UnwrapInput;
use super::unroll::{Proposal, charts_of};
use super::unwrapper::{Cancel, UnwrapError, UnwrapOptions, UnwrappedMesh, Unwrapper};

/// Largest mesh given to xatlas: at most a minute at the highest cost measured within the next two
/// limits, 0.7 ms per triangle (`examples/unwrap_cost.rs`).
pub const MAX_TRIANGLES: usize = 60_000;

/// Most triangles in one piece. Time grows with the square of a flat chart's triangles: a terrain
/// takes 0.3 ms per triangle with 2,000 triangles, 0.8 ms with 4,000 and 4 ms with 16,000.
const PIECE: usize = 2_000;

/// Most pieces. Packing time is quadratic too: loose triangles take 0.6 ms each if there are
/// 16,000, and 1 ms if there are 32,000.
const PIECES: usize = 16_000;

/// How often the waiting thread checks for cancellation.
const POLL: Duration = Duration::from_millis(50);

/// xatlas of 2019.
#[derive(Debug, Clone, Copy, Default)]
pub struct Xatlas;

impl Unwrapper for Xatlas {
    fn name(&self) -> &'static str {
        "xatlas"
    }

    fn unwrap(
        &self,
        mesh: &UnwrapInput,
        options: &UnwrapOptions,
        cancel: Cancel<'_>,
    ) -> Result<UnwrappedMesh, UnwrapError> {
        if mesh.triangles.len() > MAX_TRIANGLES {
            return Err(UnwrapError::Failed(format!(
                "more than {MAX_TRIANGLES} triangles"
            )));
        }
        let regions = split_regions(mesh);
        if regions.len() > PIECES {
            return Err(UnwrapError::Failed(format!("more than {PIECES} pieces")));
        }
        let charts = run_guarded(regions, cancel)?;
        let mut uv = vec![None; mesh.triangles.len()];
        for (t, corners) in charts {
            uv[t as usize] = Some(corners);
        }
        let lumel = 1.0 / f64::from(options.texels_per_unit);
        let charts = charts_of(mesh, islands(mesh, &uv), lumel, cancel)?;
        finish(mesh, charts, options, cancel)
    }
}

/// Triangles connected by edges with the same coordinates on both sides, or with none.
fn islands(mesh: &UnwrapInput, uv: &[Option<[Vec2; 3]>]) -> Vec<Proposal> {
    let connected = |t: usize, k: usize| {
        let u = mesh.neighbors[t][k] as usize;
        let (Some(own), Some(other)) = (uv[t], uv[u]) else {
            return uv[t].is_none() && uv[u].is_none();
        };
        [k, (k + 1) % 3].into_iter().all(|k| {
            let vertex = mesh.triangles[t][k];
            (0..3).any(|l| mesh.triangles[u][l] == vertex && other[l] == own[k])
        })
    };
    let (island, count) = mesh.components(|t, k| !mesh.seams[t][k] && connected(t, k));
    let mut islands: Vec<Proposal> = (0..count).map(|_| (Vec::new(), Some(Vec::new()))).collect();
    for (t, &island) in island.iter().enumerate() {
        let (faces, corners) = &mut islands[island as usize];
        faces.push(t as u32);
        match (uv[t], &mut *corners) {
            (Some(uv), Some(corners)) => corners.push(uv.map(|p| p.as_dvec2())),
            _ => *corners = None,
        }
    }
    islands
}

/// One region bounded by seams, given to xatlas as a separate mesh, so that no chart crosses a
/// seam.
struct Region {
    /// Indices of its triangles in the whole mesh.
    source: Vec<u32>,
    positions: Vec<Vec3>,
    indices: Vec<u32>,
}

fn split_regions(mesh: &UnwrapInput) -> Vec<Region> {
    let (region, count) = mesh.components(|t, k| !mesh.seams[t][k]);
    // Scaled to a mean triangle of one square unit, a range in which f32 is accurate for any sane
    // mesh.
    let area: f64 = mesh.areas().iter().sum();
    let mean = area / mesh.triangles.len().max(1) as f64;
    let scale = if mean > 0.0 { mean.sqrt().recip() } else { 1.0 };
    let mut sources: Vec<Vec<u32>> = vec![Vec::new(); count as usize];
    for (t, &r) in region.iter().enumerate() {
        sources[r as usize].push(t as u32);
    }
    let pieces = sources.into_iter().flat_map(|s| halve(mesh, s));
    let mut regions: Vec<Region> = pieces
        .map(|source| Region {
            source,
            positions: Vec::new(),
            indices: Vec::new(),
        })
        .collect();
    for r in &mut regions {
        let mut used: Vec<u32> = r
            .source
            .iter()
            .flat_map(|&t| mesh.triangles[t as usize])
            .collect();
        used.sort_unstable();
        used.dedup();
        // Relative to the region's first vertex, because coordinates far from the origin lose
        // digits.
        let origin = mesh.positions[used[0] as usize].as_dvec3();
        r.positions = used
            .iter()
            .map(|&v| ((mesh.positions[v as usize].as_dvec3() - origin) * scale).as_vec3())
            .collect();
        let local = |v: u32| used.binary_search(&v).unwrap_or(0) as u32;
        r.indices = r
            .source
            .iter()
            .flat_map(|&t| mesh.triangles[t as usize].map(local))
            .collect();
    }
    regions
}

/// Splits triangles at the median along the longest side of their box, until no piece has more than
/// [`PIECE`].
fn halve(mesh: &UnwrapInput, source: Vec<u32>) -> Vec<Vec<u32>> {
    let (mut done, mut todo) = (Vec::new(), vec![source]);
    while let Some(mut piece) = todo.pop() {
        if piece.len() <= PIECE {
            // In the original order, independent of the splits.
            piece.sort_unstable();
            done.push(piece);
            continue;
        }
        let sum = |t: u32| -> Vec3 {
            let corners = mesh.triangles[t as usize].map(|i| mesh.positions[i as usize]);
            corners.into_iter().sum()
        };
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for p in piece.iter().map(|&t| sum(t)) {
            (low, high) = (low.min(p), high.max(p));
        }
        let axis = (high - low).max_position();
        piece.sort_unstable_by(|&a, &b| {
            let [x, y] = [a, b].map(|t| sum(t)[axis]);
            x.total_cmp(&y).then(a.cmp(&b))
        });
        let right = piece.split_off(piece.len() / 2);
        todo.extend([right, piece]);
    }
    done
}

/// Texture coordinates of one triangle's corners, in xatlas's texels, by triangle index.
type Charted = Vec<(u32, [Vec2; 3])>;

/// Runs xatlas in its own thread, and abandons that thread when `cancel` asks to stop.
fn run_guarded(regions: Vec<Region>, cancel: Cancel<'_>) -> Result<Charted, UnwrapError> {
    if regions.is_empty() || cancel() {
        return Err(UnwrapError::Cancelled);
    }
    let abandoned = Arc::new(AtomicBool::new(false));
    let (sender, receiver) = channel();
    let flag = Arc::clone(&abandoned);
    std::thread::Builder::new()
        .name("xatlas".into())
        .stack_size(64 << 20)
        .spawn(move || {
            let outcome = run(&regions, &flag);
            // The handle is sent after the result, because destroying it may hang. If the wait was
            // given up, the receiver is gone and the result is not needed.
            let (result, _handle) = match outcome {
                Ok((charted, handle)) => (Ok(charted), Some(handle)),
                Err(error) => (Err(error), None),
            };
            let _ = sender.send(result);
        })
        .map_err(|e| UnwrapError::Failed(format!("cannot start a thread for xatlas: {e}")))?;
    loop {
        match receiver.recv_timeout(POLL) {
            Ok(result) => return result.map_err(UnwrapError::Failed),
            Err(RecvTimeoutError::Disconnected) => {
                return Err(UnwrapError::Failed("xatlas ended early".into()));
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
        if cancel() {
            abandoned.store(true, Ordering::Relaxed);
            return Err(UnwrapError::Cancelled);
        }
    }
}

/// Charts of all regions with xatlas's defaults, and the handle, which is still to be destroyed.
fn run(regions: &[Region], abandoned: &AtomicBool) -> Result<(Charted, Handle), String> {
    let atlas = Handle::new()?;
    for region in regions {
        atlas.add(region)?;
    }
    atlas.generate(abandoned);
    let charted = atlas.read(regions)?;
    Ok((charted, atlas))
}

/// An owned `xatlas::Atlas`.
struct Handle(*mut ffi::Atlas);

impl Handle {
    fn new() -> Result<Handle, String> {
        // SAFETY: plain calls without preconditions. `SetPrint` stores a null function pointer,
        // which xatlas checks for.
        let atlas = unsafe {
            ffi::set_print(None, false);
            ffi::create()
        };
        if atlas.is_null() {
            return Err("xatlas returned no atlas".into());
        }
        Ok(Handle(atlas))
    }

    fn add(&self, region: &Region) -> Result<(), String> {
        let decl = ffi::MeshDecl {
            vertex_count: region.positions.len() as u32,
            position_data: region.positions.as_ptr().cast(),
            position_stride: size_of::<Vec3>() as u32,
            normal_data: std::ptr::null(),
            normal_stride: 0,
            uv_data: std::ptr::null(),
            uv_stride: 0,
            index_count: region.indices.len() as u32,
            index_data: region.indices.as_ptr().cast(),
            index_offset: 0,
            index_format: 1,
            face_ignore_data: std::ptr::null(),
        };
        // SAFETY: the handle is live; counts, strides (12 bytes, three floats) and the 32-bit index
        // format describe the two slices, which outlive the call (xatlas copies them). Every index
        // is in range by construction.
        let code = unsafe { ffi::add_mesh(self.0, &decl) };
        match code {
            0 => Ok(()),
            _ => Err(format!("xatlas refused the mesh (code {code})")),
        }
    }

    fn generate(&self, abandoned: &AtomicBool) {
        let user = std::ptr::from_ref(abandoned).cast_mut().cast::<c_void>();
        // SAFETY: the handle is live and has meshes; the options are passed by value with the C
        // layout of the 2019 header; `user` outlives the call, and the callback never unwinds.
        unsafe {
            ffi::generate(
                self.0,
                ffi::ChartOptions::default(),
                None,
                ffi::PackOptions::default(),
                Some(progress),
                user,
            );
        }
    }

    fn read(&self, regions: &[Region]) -> Result<Charted, String> {
        // SAFETY: after `generate`, `meshes` holds `mesh_count` meshes, each with the counts in it;
        // xatlas owns them until the handle is destroyed, and nothing writes to them any more. Null
        // pointers are turned into empty slices.
        let meshes = unsafe {
            let atlas = &*self.0;
            slice(atlas.meshes, atlas.mesh_count)
        };
        if meshes.len() != regions.len() {
            return Err("xatlas lost meshes".into());
        }
        let mut charted = Vec::new();
        for (mesh, region) in meshes.iter().zip(regions) {
            // SAFETY: as above.
            let (vertices, indices) = unsafe {
                (
                    slice(mesh.vertices, mesh.vertex_count),
                    slice(mesh.indices, mesh.index_count),
                )
            };
            // Faces that xatlas ignored are counted and have atlas index −1; faces that it lost
            // leave their indices unset.
            for (&t, corners) in region.source.iter().zip(indices.chunks_exact(3)) {
                let at = |i: u32| {
                    vertices
                        .get(i as usize)
                        .filter(|v| v.atlas == 0)
                        .map(|v| Vec2::from(v.uv))
                        .filter(|uv| uv.is_finite())
                };
                if let (Some(a), Some(b), Some(c)) =
                    (at(corners[0]), at(corners[1]), at(corners[2]))
                {
                    charted.push((t, [a, b, c]));
                }
            }
        }
        Ok(charted)
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: created by `create`, destroyed once.
        unsafe { ffi::destroy(self.0) }
    }
}

/// # Safety
/// `data` is null or points to `count` initialised values that stay unchanged for `'a`.
unsafe fn slice<'a, T>(data: *const T, count: u32) -> &'a [T] {
    if data.is_null() {
        return &[];
    }
    // SAFETY: the caller's promise.
    unsafe { std::slice::from_raw_parts(data, count as usize) }
}

/// Parks the calling thread forever once the result is not needed, because xatlas cannot be
/// stopped.
unsafe extern "C" fn progress(_category: c_int, _percent: c_int, user: *mut c_void) {
    // SAFETY: `user` is the flag given to `generate`, alive as long as the thread that runs it,
    // which never returns from here once the flag is set.
    let abandoned = unsafe { &*user.cast::<AtomicBool>() };
    while abandoned.load(Ordering::Relaxed) {
        std::thread::park();
    }
}

/// The required part of xatlas.h (2019, as vendored by xatlas-rs 0.1.3).
mod ffi {
    use std::ffi::{c_char, c_int, c_void};

    #[repr(C)]
    pub struct Vertex {
        pub atlas: i32,
        pub uv: [f32; 2],
        pub xref: u32,
    }

    #[repr(C)]
    pub struct Mesh {
        pub charts: *const c_void,
        pub chart_count: u32,
        pub indices: *const u32,
        pub index_count: u32,
        pub vertices: *const Vertex,
        pub vertex_count: u32,
    }

    #[repr(C)]
    pub struct Atlas {
        pub width: u32,
        pub height: u32,
        pub atlas_count: u32,
        pub chart_count: u32,
        pub mesh_count: u32,
        pub meshes: *const Mesh,
        pub utilization: *const f32,
        pub texels_per_unit: f32,
    }

    #[repr(C)]
    pub struct MeshDecl {
        pub vertex_count: u32,
        pub position_data: *const c_void,
        pub position_stride: u32,
        pub normal_data: *const c_void,
        pub normal_stride: u32,
        pub uv_data: *const c_void,
        pub uv_stride: u32,
        pub index_count: u32,
        pub index_data: *const c_void,
        pub index_offset: i32,
        pub index_format: c_int,
        pub face_ignore_data: *const bool,
    }

    #[repr(C)]
    #[derive(Clone, Copy)]
    pub struct ChartOptions {
        max_chart_area: f32,
        max_boundary_length: f32,
        proxy_fit_metric_weight: f32,
        roundness_metric_weight: f32,
        straightness_metric_weight: f32,
        normal_seam_metric_weight: f32,
        texture_seam_metric_weight: f32,
        max_threshold: f32,
        grow_face_count: u32,
        max_iterations: u32,
    }

    impl Default for ChartOptions {
        /// The header's defaults.
        fn default() -> Self {
            ChartOptions {
                max_chart_area: 0.0,
                max_boundary_length: 0.0,
                proxy_fit_metric_weight: 2.0,
                roundness_metric_weight: 0.01,
                straightness_metric_weight: 6.0,
                normal_seam_metric_weight: 4.0,
                texture_seam_metric_weight: 0.5,
                max_threshold: 2.0,
                grow_face_count: 32,
                max_iterations: 1,
            }
        }
    }

    #[repr(C)]
    #[derive(Clone, Copy)]
    pub struct PackOptions {
        attempts: c_int,
        texels_per_unit: f32,
        resolution: u32,
        max_chart_size: u32,
        block_align: bool,
        conservative: bool,
        padding: u32,
    }

    impl Default for PackOptions {
        /// A quick packing, because it is discarded. xatlas rounds charts to whole texels; at this
        /// resolution (64 texels per mean triangle) that hardly distorts them.
        fn default() -> Self {
            PackOptions {
                attempts: 1,
                texels_per_unit: 8.0,
                resolution: 0,
                max_chart_size: 4096,
                block_align: false,
                conservative: false,
                padding: 0,
            }
        }
    }

    pub type Progress = Option<unsafe extern "C" fn(c_int, c_int, *mut c_void)>;
    type Parameterize =
        Option<unsafe extern "C" fn(*const f32, *mut f32, u32, *const u32, u32, bool)>;
    type Print = Option<unsafe extern "C" fn(*const c_char, ...) -> c_int>;

    unsafe extern "C" {
        #[cfg_attr(not(target_env = "msvc"), link_name = "_ZN6xatlas6CreateEv")]
        #[cfg_attr(
            target_env = "msvc",
            link_name = "\u{1}?Create@xatlas@@YAPEAUAtlas@1@XZ"
        )]
        pub fn create() -> *mut Atlas;

        #[cfg_attr(not(target_env = "msvc"), link_name = "_ZN6xatlas7DestroyEPNS_5AtlasE")]
        #[cfg_attr(
            target_env = "msvc",
            link_name = "\u{1}?Destroy@xatlas@@YAXPEAUAtlas@1@@Z"
        )]
        pub fn destroy(atlas: *mut Atlas);

        #[cfg_attr(
            not(target_env = "msvc"),
            link_name = "_ZN6xatlas7AddMeshEPNS_5AtlasERKNS_8MeshDeclE"
        )]
        #[cfg_attr(
            target_env = "msvc",
            link_name = "\u{1}?AddMesh@xatlas@@YA?AW4Enum@AddMeshError@1@PEAUAtlas@1@AEBUMeshDecl@1@@Z"
        )]
        pub fn add_mesh(atlas: *mut Atlas, decl: *const MeshDecl) -> c_int;

        #[cfg_attr(
            not(target_env = "msvc"),
            link_name = "_ZN6xatlas8GenerateEPNS_5AtlasENS_12ChartOptionsEPFvPKfPfjPKjjbENS_11PackOptionsEPFvNS_16ProgressCategory4EnumEiPvESD_"
        )]
        #[cfg_attr(
            target_env = "msvc",
            link_name = "\u{1}?Generate@xatlas@@YAXPEAUAtlas@1@UChartOptions@1@P6AXPEBMPEAMIPEBII_N@ZUPackOptions@1@P6AXW4Enum@ProgressCategory@1@HPEAX@Z9@Z"
        )]
        pub fn generate(
            atlas: *mut Atlas,
            chart: ChartOptions,
            parameterize: Parameterize,
            pack: PackOptions,
            progress: Progress,
            user: *mut c_void,
        );

        #[cfg_attr(not(target_env = "msvc"), link_name = "_ZN6xatlas8SetPrintEPFiPKczEb")]
        #[cfg_attr(
            target_env = "msvc",
            link_name = "\u{1}?SetPrint@xatlas@@YAXP6AHPEBDZZ_N@Z"
        )]
        pub fn set_print(print: Print, verbose: bool);
    }
}
