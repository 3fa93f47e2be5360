//! Light at vertices.

use mesh_ingest::Scene;
use radiosity::{Cancelled, Monitor, Phase, World, hash_u32};
use rayon::prelude::*;

use crate::bake::{BakeReport, in_blocks};
use crate::gather::{GatherOptions, Gatherer};
use crate::planes::Wanted;
use crate::vertex_footprint::{Spoke, VertexFootprint};

/// Irradiance at every vertex that a triangle uses; 0 at the others.
pub(crate) fn bake_vertices(
    world: &World,
    mut gatherer: Gatherer,
    options: GatherOptions,
    monitor: &dyn Monitor,
    report: &mut BakeReport,
) -> Result<Vec<Vec<Vec<[f32; 3]>>>, Cancelled> {
    gatherer.options = options;
    // Vertices hold one colour.
    gatherer.wanted = Wanted::default();
    let corners = VertexCorners::collect(world);
    let received = in_blocks(corners.len(), Phase::Vertices, monitor, |i| {
        let (around, seed) = corners.around(world, i);
        gatherer.gather(
            &VertexFootprint {
                world,
                around,
                seed,
            },
            seed,
        )
    })?;
    report.vertices = received.len() as u64;
    report.vertex_rays = received.iter().map(|r| r.rays).sum();
    let mut out = empty_vertices(world.scene);
    for (i, r) in received.iter().enumerate() {
        let (instance, primitive, vertex) = corners.vertex(i);
        out[instance as usize][primitive as usize][vertex as usize] =
            (r.direct + r.indirect).to_array();
    }
    Ok(out)
}

fn empty_vertices(scene: &Scene) -> Vec<Vec<Vec<[f32; 3]>>> {
    scene
        .instances
        .iter()
        .map(|i| {
            scene.meshes[i.mesh]
                .primitives
                .iter()
                .map(|p| vec![[0.0; 3]; p.positions.len()])
                .collect()
        })
        .collect()
}

/// For every used vertex of every instance, the soup triangles that meet there.
struct VertexCorners {
    /// (instance, primitive, vertex, face, world corner), sorted.
    corners: Vec<(u32, u32, u32, u32, u8)>,
    /// Where each vertex's run begins; one more than there are.
    starts: Vec<u32>,
}

impl VertexCorners {
    fn collect(world: &World) -> Self {
        let faces = world.soup.len() + world.soup.duplicates.len();
        let mut corners: Vec<_> = (0..faces as u32)
            .into_par_iter()
            .filter(|&t| !world.scene.only_occludes(world.soup, t))
            .flat_map_iter(|t| {
                let s = world.soup.source(t);
                let mesh = &world.scene.meshes[world.scene.instances[s.instance as usize].mesh];
                let [a, b, c] =
                    mesh.primitives[s.primitive as usize].triangles[s.triangle as usize];
                let order = if s.mirrored { [a, c, b] } else { [a, b, c] };
                (0..3u8).map(move |k| (s.instance, s.primitive, order[k as usize], t, k))
            })
            .collect();
        corners.par_sort_unstable();
        let mut starts = Vec::new();
        for i in 0..corners.len() {
            let key = |c: &(u32, u32, u32, u32, u8)| (c.0, c.1, c.2);
            if i == 0 || key(&corners[i]) != key(&corners[i - 1]) {
                starts.push(i as u32);
            }
        }
        starts.push(corners.len() as u32);
        VertexCorners { corners, starts }
    }

    fn len(&self) -> usize {
        self.starts.len() - 1
    }

    fn vertex(&self, i: usize) -> (u32, u32, u32) {
        let c = self.corners[self.starts[i] as usize];
        (c.0, c.1, c.2)
    }

    /// Triangles about vertex `i` with running area, and a seed.
    fn around(&self, world: &World, i: usize) -> (Vec<Spoke>, u32) {
        let run = &self.corners[self.starts[i] as usize..self.starts[i + 1] as usize];
        let mut area = 0.0;
        let around = run
            .iter()
            .map(|c| {
                let (face, corner) = (c.3, c.4);
                let (triangle, corner, back) = match world.soup.duplicate(face) {
                    None => (face, corner, false),
                    Some(d) => (d.kept, d.corners[usize::from(corner)], d.turned),
                };
                area += world.soup.areas[triangle as usize];
                Spoke {
                    triangle,
                    corner,
                    back,
                    running: area,
                }
            })
            .collect();
        let seed = hash_u32(run[0].2 ^ hash_u32(run[0].1 ^ hash_u32(run[0].0 ^ 0x51ed_270b)));
        (around, seed)
    }
}
