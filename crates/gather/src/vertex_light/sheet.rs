//! The triangles of one instance for vertex light, whole or split.

use std::collections::HashMap;

use atlas::{Layout, Lumels, faces_of};
use glam::{DVec2, Vec3};
use mesh_ingest::{Primitive, Soup};
use radiosity::{SharpLights, World};

use super::moments::{Moments, texels};
use crate::vertex_footprint::Spoke;

/// Least cosine between normals in one smoothing group: 5°. Exporters round normals to a degree at
/// worst (8 bits), and visible hard edges are above ten.
const SAME_NORMAL: f32 = 0.9962;

/// Where a sun's light is compared on two sides of a vertex: at this part of the way to the middle
/// of their triangles …
const BESIDE: f32 = 0.1;

/// … if the penumbra is at most this part of it wide.
const SOFT: f32 = 0.2;

/// Most values of one smoothing group at a position: a sun and its shade, and some more where
/// several shadows end.
const MOST_SIDES: usize = 4;

/// A vertex of a primitive.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vertex {
    /// Index into the mesh's primitives.
    pub primitive: u32,
    /// Index into the primitive's vertices; added ones come after its own.
    pub index: u32,
    /// Its position: equal for all vertices of the instance at the same position.
    pub place: u32,
    /// Its point, i.e. value: equal for vertices at the same position and in the same smoothing
    /// group.
    pub point: u32,
}

/// A triangle, or a part of one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tri {
    /// The face (see [`mesh_ingest::Duplicate`]).
    pub face: u32,
    /// Index into [`Sheet::vertices`], in the primitive's corner order.
    pub corners: [u32; 3],
    /// Corners in the instance's rectangle, texels; NaN without a chart.
    pub page: [DVec2; 3],
    /// Area, m².
    pub area: f64,
    /// Integrals of the lumels on it.
    pub moments: Moments,
}

impl Tri {
    /// Area on the page, texels.
    pub fn texels(&self) -> f64 {
        texels(&self.page)
    }
}

/// All triangles of one instance that receive light.
pub(super) struct Sheet {
    /// Index into [`Scene::instances`].
    pub instance: usize,
    pub vertices: Vec<Vertex>,
    /// For each added vertex, the two vertices whose midpoint it is, as indices into `vertices`.
    pub parents: Vec<[u32; 2]>,
    pub tris: Vec<Tri>,
    /// Number of vertices of each primitive.
    pub counts: Vec<u32>,
    /// World position by place.
    pub places: Vec<Vec3>,
    /// Number of points.
    pub points: usize,
}

/// Numbers of vertices and places that a sheet has already.
struct Numbers {
    /// By primitive and its vertex; `u32::MAX` for none.
    vertices: Vec<Vec<u32>>,
    places: HashMap<[u32; 3], u32>,
}

impl Numbers {
    fn of(primitives: &[Primitive]) -> Numbers {
        Numbers {
            vertices: (primitives.iter())
                .map(|p| vec![u32::MAX; p.positions.len()])
                .collect(),
            places: HashMap::new(),
        }
    }

    /// The number in `sheet` of a vertex (primitive, index) at a position of its mesh.
    fn vertex(
        &mut self,
        sheet: &mut Sheet,
        (primitive, index): (u32, u32),
        position: Vec3,
        to_world: impl Fn(Vec3) -> Vec3,
    ) -> u32 {
        let number = &mut self.vertices[primitive as usize][index as usize];
        if *number == u32::MAX {
            *number = sheet.vertices.len() as u32;
            // Adding zero turns −0 into +0, which is the same position.
            let position = position + Vec3::ZERO;
            let next = sheet.places.len() as u32;
            let bits = position.to_array().map(f32::to_bits);
            let place = *self.places.entry(bits).or_insert(next);
            if place == next {
                sheet.places.push(to_world(position));
            }
            sheet.vertices.push(Vertex {
                primitive,
                index,
                place,
                point: u32::MAX,
            });
        }
        *number
    }
}

impl Sheet {
    /// The triangles of an instance, unsplit, without moments.
    pub fn build(
        (world, lights): (&World, &SharpLights),
        layout: &Layout,
        lumels: &Lumels,
        instance: usize,
    ) -> Sheet {
        let (scene, soup) = (world.scene, world.soup);
        let placed = &scene.instances[instance];
        let primitives = &scene.meshes[placed.mesh].primitives;
        let rect = layout.placements[instance].rect;
        let origin = DVec2::new(f64::from(rect.x), f64::from(rect.y));
        let mut sheet = Sheet {
            instance,
            vertices: Vec::new(),
            parents: Vec::new(),
            tris: Vec::new(),
            counts: (primitives.iter())
                .map(|p| p.positions.len() as u32)
                .collect(),
            places: Vec::new(),
            points: 0,
        };
        let to_world = |position: Vec3| {
            let world = placed.transform.transform_point3(position.as_dvec3());
            (world - scene.origin).as_vec3()
        };
        let mut numbers = Numbers::of(primitives);
        for face in faces_of(soup, instance) {
            let source = soup.source(face);
            let p = source.primitive as usize;
            if !scene.receives(instance, p) {
                continue;
            }
            let primitive = &primitives[p];
            let (triangle, order, _) = corners_of(soup, face);
            let corners = primitive.triangles[source.triangle as usize].map(|v| {
                let at = primitive.positions[v as usize];
                numbers.vertex(&mut sheet, (source.primitive, v), at, to_world)
            });
            let page = lumels.page_corners(face).map(|c| c.as_dvec2() - origin);
            sheet.tris.push(Tri {
                face,
                corners,
                page: order.map(|k| page[usize::from(k)]),
                area: f64::from(soup.areas[triangle as usize]),
                moments: Moments::default(),
            });
        }
        sheet.find_points(primitives, (world, lights));
        sheet
    }

    /// Gives vertices at the same position and in the same smoothing group the same point, unless
    /// the edge of a shadow ends there at which charts were cut.
    fn find_points(&mut self, primitives: &[Primitive], (world, lights): (&World, &SharpLights)) {
        let normals = self.normals(primitives);
        let inward = match lights.is_empty() {
            true => Vec::new(),
            false => self.inward(world.soup),
        };
        let parted = |a: u32, b: u32| {
            let [v, w] = [a, b].map(|v| self.vertices[v as usize]);
            !lights.is_empty() && v.primitive != w.primitive && {
                let sides = [a, b].map(|v| inward[v as usize]);
                let place = self.places[v.place as usize];
                is_shadow_edge((world, lights), place, sides)
            }
        };
        let mut order: Vec<(u32, u32)> = (self.vertices.iter().zip(0u32..))
            .map(|(v, i)| (v.place, i))
            .collect();
        order.sort_unstable();
        let mut points = 0u32;
        let mut point_of = vec![u32::MAX; self.vertices.len()];
        for at_place in order.chunk_by(|a, b| a.0 == b.0) {
            // Normals are compared with the first vertex of each group, so that no chain of small
            // steps joins different normals. A sphere has room for about two thousand groups, so
            // this is not quadratic, however many vertices share a position.
            let mut groups: Vec<(u32, u32)> = Vec::new();
            for &(_, v) in at_place {
                let normal = |v: u32| normals[v as usize];
                let alike = |(first, _): &&(u32, u32)| normal(*first).dot(normal(v)) >= SAME_NORMAL;
                let mut sides = groups.iter().filter(alike).take(MOST_SIDES).enumerate();
                let found = sides.find(|(k, (first, _))| k + 1 == MOST_SIDES || !parted(*first, v));
                point_of[v as usize] = match found {
                    Some((_, (_, point))) => *point,
                    None => {
                        groups.push((v, points));
                        points += 1;
                        points - 1
                    }
                };
            }
        }
        self.points = points as usize;
        for (vertex, point) in self.vertices.iter_mut().zip(point_of) {
            vertex.point = point;
        }
    }

    /// By vertex, the mean normal of its triangles, and the way from it to the middle of them.
    fn inward(&self, soup: &Soup) -> Vec<[Vec3; 2]> {
        let mut sums = vec![([Vec3::ZERO; 2], 0u32); self.vertices.len()];
        for tri in &self.tris {
            let (triangle, _, back) = corners_of(soup, tri.face);
            let normal = soup.normals[triangle as usize] * if back { -1.0 } else { 1.0 };
            let places = tri.corners.map(|c| {
                let place = self.vertices[c as usize].place;
                self.places[place as usize]
            });
            let middle = places.iter().sum::<Vec3>() / 3.0;
            for (c, place) in tri.corners.into_iter().zip(places) {
                let ([up, way], n) = &mut sums[c as usize];
                *up += normal;
                *way += middle - place;
                *n += 1;
            }
        }
        (sums.into_iter())
            .map(|([up, way], n)| [up.normalize_or_zero(), way / n.max(1) as f32])
            .collect()
    }

    /// Unit normals of the vertices in local space: their own, or the mean of their faces'.
    fn normals(&self, primitives: &[Primitive]) -> Vec<Vec3> {
        let mut normals = vec![Vec3::ZERO; self.vertices.len()];
        for tri in &self.tris {
            let v = tri.corners.map(|c| self.vertices[c as usize]);
            let primitive = &primitives[v[0].primitive as usize];
            if primitive.normals.is_empty() {
                let [a, b, c] = v.map(|v| primitive.positions[v.index as usize].as_dvec3());
                let area = (b - a).cross(c - a);
                // In f64 and scaled, so that neither tiny nor huge triangles leave the range of
                // f32.
                let weighted = area * (tri.area / area.length().max(f64::MIN_POSITIVE));
                for c in tri.corners {
                    normals[c as usize] += weighted.as_vec3();
                }
            }
        }
        for (n, v) in normals.iter_mut().zip(&self.vertices) {
            let primitive = &primitives[v.primitive as usize];
            *n = match primitive.normals.get(v.index as usize) {
                Some(own) => *own,
                None => n.normalize_or_zero(),
            };
        }
        normals
    }

    /// Points of a triangle's corners.
    pub fn points_of(&self, tri: &Tri) -> [usize; 3] {
        tri.corners
            .map(|c| self.vertices[c as usize].point as usize)
    }

    /// For each point that is `wanted`, the triangles around it that have too few lumels.
    pub fn spokes(&self, soup: &Soup, wanted: impl Fn(usize) -> bool) -> Vec<Vec<Spoke>> {
        let mut around: Vec<Vec<Spoke>> = vec![Vec::new(); self.points];
        for tri in self.tris.iter().filter(|t| !t.moments.measured()) {
            let (triangle, order, back) = corners_of(soup, tri.face);
            for (point, corner) in self.points_of(tri).into_iter().zip(order) {
                if !wanted(point) {
                    continue;
                }
                let list = &mut around[point];
                let before = list.last().map_or(0.0, |s| s.running);
                list.push(Spoke {
                    triangle,
                    corner,
                    back,
                    running: before + soup.areas[triangle as usize],
                });
            }
        }
        around
    }
}

/// Whether a light shines on one side of a vertex only. Of either side, its normal and the way to
/// its middle.
fn is_shadow_edge(
    (world, lights): (&World, &SharpLights),
    at: Vec3,
    sides: [[Vec3; 2]; 2],
) -> bool {
    let normal = sides[0][0];
    let reach = sides[0][1].length().min(sides[1][1].length());
    let on = at + normal * world.offset(at);
    let steps = sides.map(|side| side[1].normalize_or_zero() * (BESIDE * reach));
    lights
        .lit_side(world, on, (steps, normal), SOFT * reach)
        .is_some()
}

/// For a face: its triangle in the soup, the world corner of each of the primitive triangle's
/// corners, and whether the face is on the back.
pub(super) fn corners_of(soup: &Soup, face: u32) -> (u32, [u8; 3], bool) {
    let order = if soup.source(face).mirrored {
        [0, 2, 1]
    } else {
        [0, 1, 2]
    };
    match soup.duplicate(face) {
        None => (face, order, false),
        Some(d) => (d.kept, order.map(|k| d.corners[usize::from(k)]), d.turned),
    }
}
