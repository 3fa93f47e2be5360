//! Surfaces that let light through: masked holes, blended surfaces and glass.
//!
//! Light continues straight on. A surface reflects with its presence α(1 − τ) and transmits T = (1
//! − α) + α τ c per channel ([`mesh_ingest::Scene::transmittance`]). Shadow rays multiply T over
//! everything that they cross, which is free of noise. Gathering rays cannot follow both paths: a
//! [`Coin`] chooses the surface with a probability equal to its presence. Otherwise, the ray goes
//! on with T / (1 − presence), which is 1 for blended surfaces and a colour for glass.

use std::cell::Cell;

use glam::Vec3;
use mesh_ingest::{Scene, Soup};
use visibility::{HitFilter, Ray};

use crate::sampling::hash_u32;

/// One random decision for each ray and surface: unbiased, and the same in every run.
pub(crate) struct Coin<'a> {
    scene: &'a Scene,
    soup: &'a Soup,
    glass: Cell<bool>,
}

impl<'a> Coin<'a> {
    pub(crate) fn new(scene: &'a Scene, soup: &'a Soup) -> Self {
        Coin {
            scene,
            soup,
            glass: Cell::new(false),
        }
    }

    /// Whether the ray hit and passed glass, before or behind its end.
    pub(crate) fn passed_glass(&self) -> bool {
        self.glass.get()
    }
}

/// Whether a ray stops at a surface of this presence.
#[inline]
fn stops(presence: f32, triangle: u32, ray: &Ray) -> bool {
    if presence <= 0.0 || presence >= 1.0 {
        return presence >= 1.0;
    }
    let mut h = triangle;
    for x in (ray.origin.to_array().into_iter()).chain(ray.direction.to_array()) {
        h = hash_u32(h ^ x.to_bits());
    }
    (h as f32 / 4294967296.0) < presence
}

impl HitFilter for Coin<'_> {
    fn accept(&self, triangle: u32, u: f32, v: f32, ray: &Ray) -> bool {
        let stopped = stops(
            self.scene.presence(self.soup, triangle, u, v),
            triangle,
            ray,
        );
        if !stopped {
            let material = self.soup.materials[triangle as usize] as usize;
            let glass = self.scene.materials[material].transmission > 0.0;
            self.glass.set(self.glass.get() | glass);
        }
        stopped
    }
}

/// The transmittance along a straight path.
pub(crate) struct Glass<'a> {
    scene: &'a Scene,
    soup: &'a Soup,
    /// Whether the coin has already decided that light passes. Only its colour then remains.
    decided: bool,
    share: Cell<Vec3>,
}

impl<'a> Glass<'a> {
    /// For a shadow ray.
    pub(crate) fn straight(scene: &'a Scene, soup: &'a Soup) -> Self {
        Glass {
            scene,
            soup,
            decided: false,
            share: Cell::new(Vec3::ONE),
        }
    }

    /// For a ray that a [`Coin`] has let through all surfaces before its end.
    pub(crate) fn behind_the_coin(scene: &'a Scene, soup: &'a Soup) -> Self {
        Glass {
            decided: true,
            ..Glass::straight(scene, soup)
        }
    }

    /// Transmittance per channel.
    pub(crate) fn share(&self) -> Vec3 {
        self.share.get()
    }
}

impl HitFilter for Glass<'_> {
    fn accept(&self, triangle: u32, u: f32, v: f32, _: &Ray) -> bool {
        let mut passes = self.scene.transmittance(self.soup, triangle, u, v);
        if self.decided {
            let presence = self.scene.presence(self.soup, triangle, u, v);
            // The coin let it pass, so the presence is less than 1.
            passes /= (1.0 - presence).max(f32::MIN_POSITIVE);
        }
        let share = self.share.get() * passes;
        self.share.set(share);
        // Nothing is left to contribute.
        share == Vec3::ZERO
    }
}
