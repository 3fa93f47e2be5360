//! Batches of gathering rays.
//!
//! The rays of a footprint pass through stages: they are generated ([`sample`](crate::sample)),
//! traced, shaded, and accumulated by the caller. Paths that continue after near hits form the next
//! wave. Each ray has its own result, so neither the order of tracing nor the size of a batch
//! matters.
//!
//! Sorting a footprint's rays by direction gained nothing (lab/ideas.md).

use glam::Vec3;
use radiosity::{Incoming, SurfacePoint};

use crate::tracer::{Common, Found, Path, Ray, Tracer};

/// Results of a batch, by ray.
pub(crate) struct Traced {
    /// `None` for a ray that met a black backface.
    pub found: Vec<Option<Found>>,
    groups: usize,
    /// Radiance of ray *i* and group *g* at *i* × `groups` + *g*.
    by_group: Vec<Vec3>,
}

impl Traced {
    /// Radiance that ray `i` found, by light group.
    pub(crate) fn groups(&self, i: usize) -> &[Vec3] {
        &self.by_group[i * self.groups..(i + 1) * self.groups]
    }
}

impl Tracer<'_, '_> {
    /// Radiance that arrives at `points` along `rays`.
    pub(crate) fn trace(&self, points: &[SurfacePoint], rays: &[Ray], common: Common) -> Traced {
        let mut traced = Traced {
            found: vec![Some(Found::default()); rays.len()],
            groups: common.groups,
            by_group: vec![Vec3::ZERO; rays.len() * common.groups],
        };
        let mut wave: Vec<Path> = Vec::with_capacity(rays.len());
        wave.extend(
            (rays.iter().enumerate())
                .filter_map(|(i, ray)| Path::start(i, ray, &points[ray.point as usize])),
        );
        let mut hits: Vec<(Incoming, Vec3)> = Vec::with_capacity(wave.len());
        for bounce in 0.. {
            if wave.is_empty() {
                break;
            }
            hits.clear();
            hits.extend(
                (wave.iter()).map(|path| self.world.incoming(path.point.origin, path.direction)),
            );
            // Collected in place.
            wave = (wave.into_iter().zip(&hits))
                .filter_map(|(path, hit)| {
                    let i = path.ray as usize;
                    let parts = &mut traced.by_group[i * common.groups..(i + 1) * common.groups];
                    self.shade(path, *hit, bounce, &common, &mut traced.found[i], parts)
                })
                .collect();
        }
        traced
    }
}
