//! The scene as rays see it.

use glam::Vec3;
use mesh_ingest::{Scene, Soup};
use visibility::{BuildError, BuildOptions, Bvh, Hit, HitFilter, Ray, closest_point};

use crate::bounce::Bounce;
use crate::curved::{Curved, height};
use crate::emitters::brightness;
use crate::facing::{backed, facing};
use crate::glass::{Coin, Glass};
use crate::groups::LightGroups;
use crate::roles::{LampRoles, MaskLamps};
use crate::sky::{BrightSky, Sky};
use crate::solids::Solids;
use crate::stand_in::{Place, StandIns};

/// Rec.709 luminance of a linear colour.
#[inline]
pub fn luminance(c: Vec3) -> f32 {
    c.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// A point on a surface that receives light.
#[derive(Debug, Clone, Copy)]
pub struct SurfacePoint {
    /// The point itself, in metres, in recentred world space. On a smooth-shaded curved surface, it
    /// is on that surface and not on the facet.
    pub position: Vec3,
    /// Origin of its rays: `position` moved off the surface along `geometric`.
    pub origin: Vec3,
    /// Unit shading normal: the axis of the receiver's hemisphere.
    pub normal: Vec3,
    /// Unit geometric normal of the receiving side: no light arrives from below it.
    pub geometric: Vec3,
}

/// What a gathering ray hits.
#[derive(Debug, Clone, Copy)]
pub enum Incoming {
    /// The ray left the scene.
    Escaped,
    /// The ray hit the back of a single-sided face, which is black.
    Black,
    /// The ray hit a surface that reflects.
    Surface(Hit),
}

/// The surfaces whose backs count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Backs {
    /// Those of single-sided faces, which are black.
    Black,
    /// Those of double-sided faces too.
    All,
}

/// Options for building a [`World`].
#[derive(Debug, Clone, Default)]
pub struct WorldOptions {
    /// What rays see when they leave the scene.
    pub sky: Sky,
    /// Build options for the tree.
    pub tree: BuildOptions,
    /// Light groups to keep separate.
    pub groups: Option<LightGroups>,
    /// Changes of bounced light.
    pub bounce: Bounce,
}

/// How a triangle's own emission reaches receivers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Emission {
    None,
    /// Through [`DirectLight`](crate::DirectLight), in closed form. Rays that hit the triangle see
    /// only its reflected light.
    Sampled,
    /// Through the rays that hit the triangle.
    Gathered,
}

/// A scene with its ray-casting tree.
pub struct World<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Its triangles.
    pub soup: &'a Soup,
    /// The sky as seen by rays that leave the scene, without the part in `bright`.
    pub sky: Sky,
    /// The part of the sky that [`DirectLight`](crate::DirectLight) samples.
    pub(crate) bright: Option<BrightSky>,
    /// Light groups, if they are to be kept separate.
    pub groups: Option<LightGroups>,
    /// Changes of bounced light.
    pub bounce: Bounce,
    /// Lamps whose direct light lumels leave out, if there are any.
    pub roles: Option<LampRoles>,
    bvh: Bvh,
    two_sided: Vec<bool>,
    /// Whether [`facing`](facing()) may find another surface; per triangle that rays see.
    pub(crate) backed: Vec<bool>,
    /// Reflectance of materials with a uniform one, so that rays need not look up their triangles.
    even: Vec<Option<Vec3>>,
    /// Whether triangles of one material may differ in more than a texture.
    differ: bool,
    /// Whether any surface transmits light.
    open: bool,
    /// Whether any surface colours or dims the light that it transmits.
    tinted: bool,
    radius: f32,
    /// Per triangle; empty if nothing emits, so that such a scene costs nothing.
    emission: Vec<Emission>,
    curved: Curved,
    solids: Solids,
    stand_ins: StandIns,
}

impl<'a> World<'a> {
    /// Builds the tree and classifies emitters.
    ///
    /// # Errors
    /// Those of [`Bvh::build`]: never for a [`Soup`] from [`Soup::build`].
    pub fn build(
        scene: &'a Scene,
        soup: &'a Soup,
        options: WorldOptions,
    ) -> Result<Self, BuildError> {
        let filtered: Vec<bool> = scene
            .materials
            .iter()
            .map(|m| m.lets_light_through())
            .collect();
        let bvh = Bvh::build(
            soup.seen_triangles(),
            |t| filtered[soup.materials[t as usize] as usize],
            &options.tree,
        )?;
        let radius = soup
            .seen_triangles()
            .iter()
            .flatten()
            .map(|p| p.abs().max_element())
            .fold(0.0, f32::max);
        let (sky, bright) = BrightSky::split(options.sky);
        let off = |p| offset(p, radius);
        Ok(World {
            solids: Solids::find(scene, soup, &options.tree, off)?,
            stand_ins: StandIns::find(scene, soup, &options.tree)?,
            emission: classify_emission(scene, soup),
            curved: Curved::find(scene, soup),
            backed: backed(scene, soup, &bvh, radius),
            two_sided: scene.materials.iter().map(|m| m.double_sided).collect(),
            sky,
            bright,
            groups: options.groups,
            even: even_reflectances(scene, &options.bounce),
            differ: triangles_differ(scene),
            bounce: options.bounce,
            roles: None,
            open: (scene.materials.iter()).any(|m| m.lets_light_through()),
            tinted: scene.materials.iter().any(|m| m.transmission > 0.0),
            scene,
            soup,
            bvh,
            radius,
        })
    }

    /// The tree.
    pub fn tree(&self) -> &Bvh {
        &self.bvh
    }

    /// Whether both sides of the triangle reflect and emit light.
    #[inline]
    pub fn two_sided(&self, triangle: u32) -> bool {
        self.two_sided[self.soup.materials[triangle as usize] as usize]
    }

    /// Whether there is no light: no lamp, no emissive surface, a black sky.
    pub fn is_dark(&self) -> bool {
        self.scene.lights.is_empty()
            && self.sky.is_black()
            && self.bright.is_none()
            && self.emission.iter().all(|e| *e == Emission::None)
    }

    #[inline]
    pub(crate) fn emission(&self, triangle: u32) -> Emission {
        match self.emission.get(triangle as usize) {
            Some(e) => *e,
            None => Emission::None,
        }
    }

    /// The point at barycentrics (u, v) of world corners 1 and 2, on the front, or on the back if
    /// `back`. With `smooth`, the axis of its hemisphere is the interpolated normal. If the normals
    /// describe a curved surface, the point is on that surface (after Hanika, *Hacking the Shadow
    /// Terminator*, 2021), but at most half as far out as there is free space. A point on a
    /// triangle that rays do not see is replaced by one on the surface that the triangle stands in
    /// for.
    pub fn surface_point(
        &self,
        triangle: u32,
        u: f32,
        v: f32,
        back: bool,
        smooth: bool,
    ) -> SurfacePoint {
        if let Some(p) = self.shown(triangle, u, v, back) {
            return self.surface_point(p.triangle, p.u, p.v, p.back, smooth);
        }
        let [a, b, c] = self.soup.triangles[triangle as usize];
        let position = a + (b - a) * u + (c - a) * v;
        let side = if back { -1.0 } else { 1.0 };
        let geometric = self.soup.normals[triangle as usize] * side;
        let normal = if smooth {
            self.scene.shading_normal(self.soup, triangle, u, v) * side
        } else {
            geometric
        };
        let origin = position + geometric * self.offset(position);
        if smooth && self.curved.is(triangle) {
            let weights = [1.0 - u - v, u, v];
            let h = height(self.scene, self.soup, triangle, position, weights, side);
            return self.lifted(origin, normal, h);
        }
        SurfacePoint {
            position,
            origin,
            normal,
            geometric,
        }
    }

    /// A point on a curved surface, `height` above its facet, which contains `origin`.
    ///
    /// The geometric normal is replaced by the shading normal, so that no light is cut off at the
    /// facet's horizon. Where the surface is convex, no facet is visible. Where it is concave or
    /// occluded, rays between the horizons soon hit the facets, as they would hit the curved
    /// surface. The point never passes an occluder, and because it goes only half the distance, its
    /// height changes steadily as an occluder comes closer.
    fn lifted(&self, origin: Vec3, normal: Vec3, height: f32) -> SurfacePoint {
        let mut free = height;
        if height > 0.0 {
            let ray = Ray {
                origin,
                direction: normal,
                t_min: 0.0,
                t_max: 2.0 * height,
            };
            if let Some(hit) = self.closest_hit(&ray) {
                free = 0.5 * hit.t;
            }
        }
        let position = origin + normal * free;
        SurfacePoint {
            position,
            origin: position,
            normal,
            geometric: normal,
        }
    }

    /// The point that replaces this one if rays do not see its triangle.
    fn shown(&self, triangle: u32, u: f32, v: f32, back: bool) -> Option<Place> {
        if (triangle as usize) < self.soup.seen() {
            return None;
        }
        let instance = self.soup.sources[triangle as usize].instance as usize;
        let group = self.scene.instances[instance].stands_in?;
        let [a, b, c] = self.soup.triangles[triangle as usize];
        let position = a + (b - a) * u + (c - a) * v;
        let side = if back { -1.0 } else { 1.0 };
        let normal = self.soup.normals[triangle as usize] * side;
        let two_sided = |t| self.two_sided(t);
        self.stand_ins
            .place(group, self.soup, two_sided, position, normal)
    }

    /// Like [`surface_point`](Self::surface_point), but moved in from the triangle's edges just
    /// enough to stay on the correct side of a neighbouring face when it is moved off the surface.
    /// A point in a corner would otherwise see behind the wall. The distance is four times the
    /// offset; in smaller triangles, the point moves to the centre.
    pub fn inset_point(
        &self,
        triangle: u32,
        u: f32,
        v: f32,
        back: bool,
        smooth: bool,
    ) -> SurfacePoint {
        if let Some(p) = self.shown(triangle, u, v, back) {
            return self.inset_point(p.triangle, p.u, p.v, p.back, smooth);
        }
        let corners = self.soup.triangles[triangle as usize];
        let position = corners[0] + (corners[1] - corners[0]) * u + (corners[2] - corners[0]) * v;
        let margin = 4.0 * self.offset(position);
        // Height above each edge = barycentric × altitude; altitude = 2 area / edge.
        let area2 = 2.0 * self.soup.areas[triangle as usize];
        let edge = |i: usize, j: usize| (corners[i] - corners[j]).length();
        let least = [edge(1, 2), edge(2, 0), edge(0, 1)]
            .map(|e| (margin * e / area2.max(1e-30)).min(1.0 / 3.0));
        let mut w = [1.0 - u - v, u, v];
        if w.iter().zip(&least).all(|(w, least)| w >= least) {
            return self.surface_point(triangle, u, v, back, smooth);
        }
        for (w, least) in w.iter_mut().zip(least) {
            *w = w.max(least);
        }
        let sum = w[0] + w[1] + w[2];
        self.surface_point(triangle, w[1] / sum, w[2] / sum, back, smooth)
    }

    /// Distance in metres between the surface and the start of rays. A barycentric sum of three
    /// `f32` corners is off by at most some 4 ulp of the largest coordinate (3e-7 of it, Higham's
    /// γ₅), and so is the plane that the tree tests: 1e-6 covers both. The second term is for
    /// points near the origin whose triangles extend far from it.
    #[inline]
    pub fn offset(&self, position: Vec3) -> f32 {
        offset(position, self.radius)
    }

    /// Whether a point on a surface is inside a closed body such as a wall or a crate, where nobody
    /// sees it. This is a purely geometric test; the interiors of open shells can be found only
    /// with rays.
    pub fn inside_a_body(&self, p: &SurfacePoint) -> bool {
        self.solids.hide(p.origin, p.geometric)
    }

    /// Whether nobody sees a point on a surface: it is in a body, or something opaque lies less than
    /// `gap` metres above it, e.g. a carpet.
    pub fn out_of_sight(&self, p: &SurfacePoint, gap: f32) -> bool {
        self.inside_a_body(p) || self.covered(p, gap)
    }

    /// Whether something opaque lies less than `gap` metres above a point.
    pub(crate) fn covered(&self, p: &SurfacePoint, gap: f32) -> bool {
        let above = Ray {
            origin: p.origin,
            direction: p.geometric,
            t_min: 0.0,
            t_max: gap,
        };
        self.bvh.occluded(&above, &Opaque)
    }

    /// What arrives at `origin` from the unit `direction`, and the transmittance per channel of
    /// glass on the way.
    ///
    /// At a surface that transmits part of the light, a random decision chooses between the surface
    /// and what is behind it, so that the mean is correct. The transmittance is what remains as a
    /// colour.
    #[inline]
    pub fn incoming(&self, origin: Vec3, direction: Vec3) -> (Incoming, Vec3) {
        let ray = endless(origin, direction);
        let coin = Coin::new(self.scene, self.soup);
        let hit = (self.bvh.closest_hit(&ray, &coin)).map(|hit| self.facing(&ray, hit));
        let tint = if self.tinted && coin.passed_glass() {
            let t_max = hit.map_or(f32::INFINITY, |h| self.just_before(&ray, &h));
            let glass = Glass::behind_the_coin(self.scene, self.soup);
            self.bvh.occluded(&Ray { t_max, ..ray }, &glass);
            glass.share()
        } else {
            Vec3::ONE
        };
        let found = match hit {
            None => Incoming::Escaped,
            Some(hit) if hit.back && !self.two_sided(hit.triangle) => Incoming::Black,
            Some(hit) => Incoming::Surface(hit),
        };
        (found, tint)
    }

    /// Distance limit for a second ray that must not hit the surface that the first one hit. The
    /// tree computes hits near a ray's end with more digits, so the same surface may be slightly
    /// nearer than its own distance. A ray would then end there before it has crossed all glass.
    fn just_before(&self, ray: &Ray, hit: &Hit) -> f32 {
        // The distance from the surface's plane at which a receiver there would start.
        let height = self.soup.normals[hit.triangle as usize]
            .dot(ray.direction)
            .abs()
            * hit.t;
        let stop = 2.0 * self.offset(ray.origin + ray.direction * hit.t);
        hit.t * (1.0 - (stop / height.max(1e-30)).min(1.0))
    }

    /// The first surface along a ray, whichever side it shows.
    pub fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        let hit = (self.bvh).closest_hit(ray, &Coin::new(self.scene, self.soup))?;
        Some(self.facing(ray, hit))
    }

    /// Which side of something a ray meets. Faces back to back are the two sides of a wall without
    /// thickness, or where two solid things touch; then a ray in one of them meets both, too.
    pub(crate) fn side_met(&self, origin: Vec3, direction: Vec3) -> Side {
        let ray = endless(origin, direction);
        let coin = Coin::new(self.scene, self.soup);
        let Some(hit) = self.bvh.closest_hit(&ray, &coin) else {
            return Side::Shown(f32::INFINITY);
        };
        let shown = self.facing(&ray, hit);
        let twins = self.soup.twin(hit.triangle).is_some();
        match hit.back && !self.two_sided(hit.triangle) {
            true if shown.triangle == hit.triangle => Side::Back,
            true if !twins => Side::Either(hit.t),
            _ => Side::Shown(hit.t),
        }
    }

    /// See [`facing`](facing()).
    #[inline]
    fn facing(&self, ray: &Ray, hit: Hit) -> Hit {
        match hit.back && self.backed[hit.triangle as usize] {
            true => facing(self.scene, self.soup, &self.bvh, ray, hit),
            false => hit,
        }
    }

    /// Transmittance (per channel, 0..=1) from `origin` along `direction` (any length) to parameter
    /// `t_max`: 0 if something opaque is in between, and less than 1 behind blended surfaces or
    /// glass.
    #[inline]
    pub fn transmitted(&self, origin: Vec3, direction: Vec3, t_max: f32) -> Vec3 {
        let ray = Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max,
        };
        if !self.open {
            let hidden = self.bvh.occluded(&ray, &visibility::AcceptAll);
            return if hidden { Vec3::ZERO } else { Vec3::ONE };
        }
        let glass = Glass::straight(self.scene, self.soup);
        if self.bvh.occluded(&ray, &glass) {
            return Vec3::ZERO;
        }
        glass.share()
    }

    /// Whether something opaque, such as a wall, stands between two points of one surface. The
    /// surface's own curvature does not count.
    ///
    /// Tests two line segments, from each point to a point above the middle between them. That
    /// point is `lift` metres up, and higher if the surface is convex. A segment between two lifted
    /// points would not do: a leaning wall would pass between a point and its lifted copy. Cut-out,
    /// blended and glass surfaces do not count as walls.
    ///
    /// A cover parallel to the surface (a rug, a poster) is no wall either: if something is above
    /// either point, the segments stay below half of its height.
    pub fn wall_between(&self, a: &SurfacePoint, b: &SurfacePoint, lift: f32) -> bool {
        let blocked = |lift: f32| {
            let top = above_the_middle(a, b, lift);
            [a, b]
                .into_iter()
                .any(|end| self.bvh.occluded(&up_to(end.origin, top), &Opaque))
        };
        if !blocked(lift) {
            return false;
        }
        let headroom = |p: &SurfacePoint| {
            let ray = Ray {
                origin: p.origin,
                direction: p.normal * lift,
                t_min: 0.0,
                t_max: 1.0,
            };
            (self.bvh.closest_hit(&ray, &Opaque)).map_or(1.0, |hit| hit.t)
        };
        let room = headroom(a).min(headroom(b));
        room == 1.0 || blocked(0.5 * room * lift)
    }

    /// The first opaque surface between two points, at a fraction `t` of the way.
    pub fn first_between(&self, from: Vec3, to: Vec3) -> Option<Hit> {
        let ray = Ray {
            origin: from,
            direction: to - from,
            t_min: 0.0,
            t_max: 1.0,
        };
        self.bvh.closest_hit(&ray, &Opaque)
    }

    /// Whether a point is on a triangle that `counts`, up to this distance, metres.
    pub fn is_on(&self, p: Vec3, reach: f32, counts: impl Fn(u32) -> bool) -> bool {
        self.bvh.any_near(p - reach, p + reach, |t, corners| {
            counts(t) && closest_point(corners, p).0.distance(p) <= reach
        })
    }

    /// Whether one of the first opaque surfaces between two points, up to [`PIERCED`] of them, is a
    /// triangle that `counts`.
    pub(crate) fn any_between(&self, from: Vec3, to: Vec3, counts: impl Fn(u32) -> bool) -> bool {
        let mut ray = Ray {
            origin: from,
            direction: to - from,
            t_min: 0.0,
            t_max: 1.0,
        };
        for _ in 0..PIERCED {
            let Some(hit) = self.bvh.closest_hit(&ray, &Opaque) else {
                return false;
            };
            if counts(hit.triangle) {
                return true;
            }
            let at = from + hit.t * ray.direction;
            ray.t_min = hit.t + self.offset(at) / ray.direction.length();
        }
        false
    }

    /// Whether `a` is behind and `b` in front of a surface: the first hit on the segments of
    /// [`wall_between`](Self::wall_between) shows its back to `a` and its front to `b`.
    pub fn backs_onto(&self, a: &SurfacePoint, b: &SurfacePoint, lift: f32, of: Backs) -> bool {
        let top = above_the_middle(a, b, lift);
        let first = |end: &SurfacePoint| {
            let ray = up_to(end.origin, top);
            (self.bvh.closest_hit(&ray, &Opaque)).map(|hit| self.facing(&ray, hit))
        };
        // One of the two segments may hit nothing.
        let shows = |hit: Option<Hit>, back: bool| {
            hit.map(|h| h.back == back && (of == Backs::All || !self.two_sided(h.triangle)))
        };
        match (shows(first(a), true), shows(first(b), false)) {
            (None, None) => false,
            (a, b) => a.unwrap_or(true) && b.unwrap_or(true),
        }
    }

    /// Whether anything rises above the plane through `p` within a box of half-size `reach` around
    /// it. Geometry in the plane, up to rounding, does not count.
    pub fn anything_above(&self, p: &SurfacePoint, reach: f32) -> bool {
        let (low, high) = (p.position - reach, p.position + reach);
        let floor = (4.0 * self.offset(p.position)).max(1e-3 * reach);
        let (from, to) = bounds_above(p.geometric, floor, reach);
        // Slightly larger, for rounding. Without the restriction to the upper half, most queries
        // above a floor would find the floor's boxes.
        let slack = 1e-5 * reach + self.offset(p.position);
        let (from, to) = (p.position + from - slack, p.position + to + slack);
        self.bvh.any_near(from, to, |_, corners| {
            let height = |q: Vec3| (q - p.position).dot(p.geometric) - floor;
            let mut part: Polygon = corners.into_iter().collect();
            part = clip(&part, height);
            for axis in 0..3 {
                if part.is_empty() {
                    return false;
                }
                part = clip(&part, |q| q[axis] - low[axis]);
                part = clip(&part, |q| high[axis] - q[axis]);
            }
            !part.is_empty()
        })
    }

    /// Whether surfaces may change the colour of transmitted light, so that the transmittance of
    /// [`incoming`](Self::incoming) can differ from 1.
    pub(crate) fn tinted(&self) -> bool {
        self.tinted
    }

    /// Number of light groups kept separate; 1 without light groups.
    pub fn group_count(&self) -> usize {
        self.groups.as_ref().map_or(1, |g| g.count)
    }

    /// The light group of a triangle's emission.
    #[inline]
    pub fn emission_group(&self, triangle: u32) -> usize {
        match &self.groups {
            Some(g) => g.materials[self.soup.materials[triangle as usize] as usize] as usize,
            None => 0,
        }
    }

    /// The light group of a lamp.
    #[inline]
    pub(crate) fn lamp_group(&self, light: usize) -> usize {
        self.groups.as_ref().map_or(0, |g| g.lights[light] as usize)
    }

    /// Whether lumels leave out the direct light of a lamp.
    #[inline]
    pub fn leaves_out(&self, light: usize) -> bool {
        self.roles.as_ref().is_some_and(|r| r.leaves_out(light))
    }

    /// Whether a lamp has a channel in the shadow masks.
    pub(crate) fn is_masked(&self, light: usize) -> bool {
        let channels = self.roles.as_ref().map(|r| &r.channels[..]);
        channels
            .and_then(|c| c.get(light))
            .is_some_and(Option::is_some)
    }

    /// The lamps of the shadow mask of an instance.
    pub fn mask_lamps(&self, instance: usize) -> MaskLamps {
        let masks = self.roles.as_ref().map(|r| &r.masks[..]);
        masks
            .and_then(|m| m.get(instance).copied())
            .unwrap_or_default()
    }

    /// The light group of the sky.
    #[inline]
    pub fn sky_group(&self) -> usize {
        self.groups.as_ref().map_or(0, |g| g.sky as usize)
    }

    /// Whether a triangle transmits light or has holes.
    #[inline]
    pub fn lets_light_through(&self, triangle: u32) -> bool {
        self.open && self.scene.needs_alpha(self.soup.material(triangle))
    }

    /// Reflectance with which light bounces off a hit (linear, per channel), for any face including
    /// duplicates.
    #[inline]
    pub fn reflectance(&self, triangle: u32, u: f32, v: f32) -> Vec3 {
        if let Some(even) = self.even[self.soup.material(triangle) as usize] {
            return even;
        }
        let own = self.scene.base_color(self.soup, triangle, u, v).truncate();
        self.bounced(triangle, own)
    }

    /// The surface's own reflectance, whatever [`Bounce`] makes of it.
    pub fn own_reflectance(&self, triangle: u32, u: f32, v: f32) -> Vec3 {
        if self.bounce.keeps_reflectance() {
            return self.reflectance(triangle, u, v);
        }
        self.scene.base_color(self.soup, triangle, u, v).truncate()
    }

    /// What [`Bounce`] makes of a triangle's own reflectance.
    #[inline]
    pub(crate) fn bounced(&self, triangle: u32, own: Vec3) -> Vec3 {
        if self.bounce.keeps_reflectance() {
            return own;
        }
        let material = &self.scene.materials[self.soup.material(triangle) as usize];
        self.bounce.reflectance(own, material.max_reflectance)
    }

    /// Reflectance of a triangle whose material has the same everywhere.
    #[inline]
    pub(crate) fn even_reflectance(&self, triangle: u32) -> Option<Vec3> {
        let material = *self.soup.materials.get(triangle as usize)?;
        self.even[material as usize]
    }

    /// The same for triangles whose reflectance is the same on average: those of a material.
    #[inline]
    pub(crate) fn pattern(&self, triangle: u32) -> u32 {
        match self.soup.materials.get(triangle as usize) {
            Some(&material) if !self.differ => material,
            _ => !triangle,
        }
    }

    /// The sky including the part that [`DirectLight`](crate::DirectLight) samples.
    pub fn whole_sky(&self) -> Sky {
        let mut sky = self.sky.clone();
        if let (Sky::Map { pixels, .. }, Some(bright)) = (&mut sky, &self.bright) {
            bright.add_to(pixels);
        }
        sky
    }

    /// Radiance emitted at a hit that an eye sees, however receivers get it. Area lights are
    /// invisible, as lamps are.
    pub fn seen_emission(&self, triangle: u32, u: f32, v: f32) -> Vec3 {
        // Their surfaces are not in the document, and nearly transparent.
        let material = &self.scene.materials[self.soup.material(triangle) as usize];
        match self.emission(triangle) {
            _ if material.gltf_material.is_none() => Vec3::ZERO,
            Emission::None => Vec3::ZERO,
            Emission::Sampled | Emission::Gathered => {
                self.scene.emission(self.soup, triangle, u, v)
            }
        }
    }

    /// Radiance emitted at a hit that gathering rays should include (see
    /// [`Emitters`](crate::Emitters)).
    #[inline]
    pub fn gathered_emission(&self, triangle: u32, u: f32, v: f32) -> Vec3 {
        if self.emission(triangle) == Emission::Gathered {
            self.scene.emission(self.soup, triangle, u, v)
        } else {
            Vec3::ZERO
        }
    }
}

/// What [`World::side_met`] finds, with its distance.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Side {
    /// A surface that shows itself, or nothing at an infinite distance.
    Shown(f32),
    /// The back of a single-sided face.
    Back,
    /// That, and a surface that shows itself in the same place.
    Either(f32),
}

/// A triangle clipped by seven planes has at most ten corners.
type Polygon = smallvec::SmallVec<[Vec3; 10]>;

/// Bounds of the part of the cube of half-size `reach` around the origin that is at least `floor`
/// above the plane with normal `n`.
fn bounds_above(n: Vec3, floor: f32, reach: f32) -> (Vec3, Vec3) {
    let (mut low, mut high) = (Vec3::splat(-reach), Vec3::splat(reach));
    let all = reach * n.abs().element_sum();
    for axis in 0..3 {
        // The largest height that the other axes can contribute.
        let others = all - reach * n[axis].abs();
        let edge = (floor - others) / n[axis];
        if n[axis] > 0.0 {
            low[axis] = low[axis].max(edge);
        } else if n[axis] < 0.0 {
            high[axis] = high[axis].min(edge);
        }
    }
    (low, high)
}

/// The part of a convex polygon where `height` is not negative.
fn clip(polygon: &Polygon, height: impl Fn(Vec3) -> f32) -> Polygon {
    let mut out = Polygon::new();
    for (k, &a) in polygon.iter().enumerate() {
        let b = polygon[(k + 1) % polygon.len()];
        let (ha, hb) = (height(a), height(b));
        if ha >= 0.0 {
            out.push(a);
        }
        if (ha >= 0.0) != (hb >= 0.0) {
            out.push(a.lerp(b, ha / (ha - hb)));
        }
    }
    out
}

/// Surfaces that [`World::any_between`] looks through: leaves and the two sides of a piece itself.
const PIERCED: usize = 4;

/// Stops only at fully opaque surfaces.
struct Opaque;

impl HitFilter for Opaque {
    fn accept(&self, _: u32, _: f32, _: f32, _: &Ray) -> bool {
        false
    }
}

/// Whether triangles of one material may differ in more than a texture, because vertices have
/// colours or instances only occlude.
fn triangles_differ(scene: &Scene) -> bool {
    let mut primitives = scene.meshes.iter().flat_map(|m| &m.primitives);
    primitives.any(|p| !p.colors.is_empty()) || scene.instances.iter().any(|i| i.occluder)
}

/// Reflectance by material, for materials without a texture. `None` if
/// [`triangles_differ`].
fn even_reflectances(scene: &Scene, bounce: &Bounce) -> Vec<Option<Vec3>> {
    let differ = triangles_differ(scene);
    (scene.materials.iter())
        .map(|m| match m.base_texture {
            None if !differ && m.occluder_only => Some(Vec3::ZERO),
            None if !differ => {
                let c = m.base_color.truncate().clamp(Vec3::ZERO, Vec3::ONE);
                let own = c.min(Vec3::splat(m.max_reflectance));
                Some(bounce.reflectance(own, m.max_reflectance))
            }
            _ => None,
        })
        .collect()
}

/// A point above the middle between two points of one surface: `lift` metres up, and higher if the
/// surface is convex.
fn above_the_middle(a: &SurfacePoint, b: &SurfacePoint, lift: f32) -> Vec3 {
    let way = b.position - a.position;
    // Where two planes meet in a ridge, each point is this far below the other's plane. Above the
    // middle of the segment, the ridge rises by at most half of this over the cosine of half the
    // angle between the planes: 0.6 of it up to 65°, the sharpest edge within a chart.
    let below = (-a.geometric.dot(way)).max(b.geometric.dot(way)).max(0.0);
    let up = (a.geometric + b.geometric).normalize_or(a.geometric);
    0.5 * (a.origin + b.origin) + up * (lift + 0.75 * below)
}

/// [`World::offset`] in a scene whose largest coordinate is `radius`.
pub(crate) fn offset(position: Vec3, radius: f32) -> f32 {
    1e-6 * position.abs().max_element() + 2e-7 * radius
}

/// A ray to a point and a thousandth further: of two that meet there, at least one crosses a wall
/// through the point. Levels are built on grids, so walls often pass half-way between two lumels.
fn up_to(origin: Vec3, to: Vec3) -> Ray {
    Ray {
        origin,
        direction: to - origin,
        t_min: 0.0,
        t_max: 1.001,
    }
}

/// A ray that ends nowhere.
fn endless(origin: Vec3, direction: Vec3) -> Ray {
    Ray {
        origin,
        direction,
        t_min: 0.0,
        t_max: f32::INFINITY,
    }
}

/// Decides for each triangle how its emission reaches receivers.
///
/// Small bright lamps use closed forms and shadow rays, because a hemisphere of rays finds them too
/// rarely. For gathering rays, a surface whose radiance is close to what surfaces send anyway (a
/// luminous ceiling, the walls of a furnace) is no harder than a reflecting one, and a closed form
/// for each of its triangles would be expensive. The threshold is four times the mean radiance
/// Σ Φ/(π Σ A). At the threshold, the emitter covers a quarter of the scene's surface, and the
/// error of the two methods is similar.
///
/// For a textured triangle, the brightness of its light counts instead of its mean brightness: a
/// sign that glows in a dark wall is a small lamp.
fn classify_emission(scene: &Scene, soup: &Soup) -> Vec<Emission> {
    let glows: Vec<bool> = scene
        .materials
        .iter()
        .map(|m| m.emissive != Vec3::ZERO && !m.occluder_only)
        .collect();
    if !glows.iter().any(|&g| g) {
        return Vec::new();
    }
    let glowing: Vec<u32> = (0..soup.seen() as u32)
        .filter(|&t| glows[soup.materials[t as usize] as usize])
        .collect();
    let brightness = brightness(scene, soup, &glowing);
    let area: f64 = soup.areas[..soup.seen()].iter().map(|a| *a as f64).sum();
    let flux: f64 = (glowing.iter().zip(&brightness))
        .map(|(&t, b)| b.mean as f64 * soup.areas[t as usize] as f64)
        .sum();
    let border = 4.0 * flux / area.max(1e-300);
    let mut emission = vec![Emission::None; soup.triangles.len()];
    for (&t, b) in glowing.iter().zip(&brightness) {
        if b.mean > 0.0 {
            emission[t as usize] = if (b.bright as f64) < border {
                Emission::Gathered
            } else {
                Emission::Sampled
            };
        }
    }
    emission
}

#[cfg(test)]
mod tests;
