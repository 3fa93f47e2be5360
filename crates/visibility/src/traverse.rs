//! Traversal: nearest child first for closest hits, any order for occlusion; single rays or slices.

use std::mem::MaybeUninit;

use crate::bvh::Bvh;
#[cfg(target_arch = "x86_64")]
use crate::kernel::avx2::Avx2;
use crate::kernel::portable::Portable;
use crate::kernel::{Isa, Kernel, Lanes, Prepared, WIDEN};
use crate::node::{Child, FILTERED, WIDTH};
use crate::ray::{Hit, HitFilter, Ray};

/// Entries of the traversal stack on the program's stack: enough for 36 levels, i.e. for any tree
/// that is not degenerate.
const INLINE_STACK: usize = 256;

/// The bits of the entry distance above the child word. Distances are not negative, so entries
/// order like distances, and equal distances order by child.
type Entry = u64;

impl Bvh {
    /// The hit with the smallest `t` in (`t_min`, `t_max`) that the filter accepts; of several at
    /// equal `t` the one with the lowest triangle index.
    pub fn closest_hit(&self, ray: &Ray, filter: &impl HitFilter) -> Option<Hit> {
        match self.isa {
            Isa::Portable => closest_one::<Portable>(self, ray, filter),
            // SAFETY: `Isa::Avx2` is only chosen by detection.
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => unsafe { closest_avx2(self, ray, filter) },
        }
    }

    /// Whether there is any hit in (`t_min`, `t_max`) that the filter accepts.
    pub fn occluded(&self, ray: &Ray, filter: &impl HitFilter) -> bool {
        match self.isa {
            Isa::Portable => occluded_one::<Portable>(self, ray, filter),
            // SAFETY: `Isa::Avx2` is only chosen by detection.
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => unsafe { occluded_avx2(self, ray, filter) },
        }
    }

    /// [`Bvh::closest_hit`] of each ray, stored at the same index in `hits`.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn closest_hits(&self, rays: &[Ray], filter: &impl HitFilter, hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.closest_hit(ray, filter);
        }
    }

    /// [`Bvh::occluded`] of each ray, stored at the same index in `hidden`.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn occluded_many(&self, rays: &[Ray], filter: &impl HitFilter, hidden: &mut [bool]) {
        assert_eq!(rays.len(), hidden.len(), "one answer per ray");
        for (ray, hidden) in rays.iter().zip(hidden) {
            *hidden = self.occluded(ray, filter);
        }
    }

    /// Entries that the stack needs at most: each level leaves seven siblings behind, and the last
    /// pushes eight.
    fn stack_need(&self) -> usize {
        self.depth as usize * (WIDTH - 1) + 1
    }
}

/// # Safety
/// The machine supports AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn closest_avx2<F: HitFilter>(bvh: &Bvh, ray: &Ray, filter: &F) -> Option<Hit> {
    closest_one::<Avx2>(bvh, ray, filter)
}

/// # Safety
/// The machine supports AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn occluded_avx2<F: HitFilter>(bvh: &Bvh, ray: &Ray, filter: &F) -> bool {
    occluded_one::<Avx2>(bvh, ray, filter)
}

#[inline(always)]
fn closest_one<K: Kernel>(bvh: &Bvh, ray: &Ray, filter: &impl HitFilter) -> Option<Hit> {
    let prepared = Prepared::new(ray)?;
    if bvh.stack_need() <= INLINE_STACK {
        closest::<K>(
            bvh,
            ray,
            &prepared,
            filter,
            &mut [MaybeUninit::uninit(); INLINE_STACK],
        )
    } else {
        closest::<K>(
            bvh,
            ray,
            &prepared,
            filter,
            &mut vec![MaybeUninit::uninit(); bvh.stack_need()],
        )
    }
}

#[inline(always)]
fn occluded_one<K: Kernel>(bvh: &Bvh, ray: &Ray, filter: &impl HitFilter) -> bool {
    let Some(prepared) = Prepared::new(ray) else {
        return false;
    };
    if bvh.stack_need() <= INLINE_STACK {
        occluded::<K>(
            bvh,
            ray,
            &prepared,
            filter,
            &mut [MaybeUninit::uninit(); INLINE_STACK],
        )
    } else {
        occluded::<K>(
            bvh,
            ray,
            &prepared,
            filter,
            &mut vec![MaybeUninit::uninit(); bvh.stack_need()],
        )
    }
}

/// Pushes the children in `mask` so that the nearest is on top. Returns the new length.
#[inline(always)]
fn push_children(
    stack: &mut [MaybeUninit<Entry>],
    len: usize,
    mut mask: u32,
    near: &[f32; WIDTH],
    children: &[u32; WIDTH],
) -> usize {
    let mut end = len;
    while mask != 0 {
        let slot = mask.trailing_zeros() as usize & (WIDTH - 1);
        mask &= mask - 1;
        let entry = Entry::from(near[slot].to_bits()) << 32 | Entry::from(children[slot]);
        // Insertion sort from the top, because two or three children are typical.
        let mut at = end;
        while at > len {
            // SAFETY: entries below `end` were written before.
            let below = unsafe { stack[at - 1].assume_init() };
            if below >= entry {
                break;
            }
            stack[at] = MaybeUninit::new(below);
            at -= 1;
        }
        stack[at] = MaybeUninit::new(entry);
        end += 1;
    }
    end
}

#[inline(always)]
fn closest<K: Kernel>(
    bvh: &Bvh,
    ray: &Ray,
    prepared: &Prepared,
    filter: &impl HitFilter,
    stack: &mut [MaybeUninit<Entry>],
) -> Option<Hit> {
    if bvh.nodes.is_empty() {
        return None;
    }
    // Index 0 loses every tie, so a hit at exactly `t_max` does not count.
    let mut best = Hit {
        triangle: 0,
        t: prepared.t_max,
        u: 0.0,
        v: 0.0,
        back: false,
    };
    let mut found = false;
    let mut near = [0.0; WIDTH];
    let mut lanes = Lanes::default();
    let mut len = 0;
    let mut child = Child::node(0);
    loop {
        if child.is_leaf() {
            for pack in &bvh.packs[child.packs()] {
                // SAFETY: the caller chose the kernel by detection.
                let mut hits = unsafe { K::triangles(pack, prepared, best.t, &mut lanes) };
                while hits != 0 {
                    let lane = hits.trailing_zeros() as usize & 3;
                    hits &= hits - 1;
                    let (t, u, v) = (lanes.t[lane], lanes.u[lane], lanes.v[lane]);
                    let triangle = pack.ids[lane] & !FILTERED;
                    let nearer = t < best.t || (t == best.t && found && triangle < best.triangle);
                    if nearer
                        && (pack.ids[lane] & FILTERED == 0 || filter.accept(triangle, u, v, ray))
                    {
                        found = true;
                        best = Hit {
                            triangle,
                            t,
                            u,
                            v,
                            back: lanes.back >> lane & 1 != 0,
                        };
                    }
                }
            }
        } else {
            let node = &bvh.nodes[child.0 as usize];
            // SAFETY: the caller chose the kernel by detection.
            let mask = unsafe { K::boxes(node, prepared, best.t, &mut near) };
            if mask != 0 {
                if mask & (mask - 1) == 0 {
                    child = Child(node.children[mask.trailing_zeros() as usize & (WIDTH - 1)]);
                    continue;
                }
                len = push_children(stack, len, mask, &near, &node.children);
            }
        }
        let limit = best.t * WIDEN;
        loop {
            if len == 0 {
                if found {
                    best.t *= prepared.t_scale;
                    return Some(best);
                }
                return None;
            }
            len -= 1;
            // SAFETY: entries below `len` were written by `push_children`.
            let entry = unsafe { stack[len].assume_init() };
            if f32::from_bits((entry >> 32) as u32) <= limit {
                child = Child(entry as u32);
                break;
            }
        }
    }
}

#[inline(always)]
fn occluded<K: Kernel>(
    bvh: &Bvh,
    ray: &Ray,
    prepared: &Prepared,
    filter: &impl HitFilter,
    stack: &mut [MaybeUninit<Entry>],
) -> bool {
    if bvh.nodes.is_empty() {
        return false;
    }
    let mut near = [0.0; WIDTH];
    let mut lanes = Lanes::default();
    let mut len = 0;
    let mut child = Child::node(0);
    loop {
        if child.is_leaf() {
            for pack in &bvh.packs[child.packs()] {
                // SAFETY: the caller chose the kernel by detection.
                let mut hits = unsafe { K::triangles(pack, prepared, prepared.t_max, &mut lanes) };
                while hits != 0 {
                    let lane = hits.trailing_zeros() as usize & 3;
                    hits &= hits - 1;
                    let id = pack.ids[lane];
                    // The filter is only called for hits before `t_max`, because it may count them.
                    if lanes.t[lane] < prepared.t_max
                        && (id & FILTERED == 0
                            || filter.accept(id & !FILTERED, lanes.u[lane], lanes.v[lane], ray))
                    {
                        return true;
                    }
                }
            }
        } else {
            let node = &bvh.nodes[child.0 as usize];
            // SAFETY: the caller chose the kernel by detection.
            let mut mask = unsafe { K::boxes(node, prepared, prepared.t_max, &mut near) };
            // In the order of the slots, which the collapse has optimised. Ordering by distance was
            // 1.6 times slower than even the unoptimised slot order.
            while mask != 0 {
                let slot = mask.trailing_zeros() as usize & (WIDTH - 1);
                mask &= mask - 1;
                stack[len] = MaybeUninit::new(Entry::from(node.children[slot]));
                len += 1;
            }
        }
        if len == 0 {
            return false;
        }
        len -= 1;
        // SAFETY: entries below `len` were written above.
        child = Child(unsafe { stack[len].assume_init() } as u32);
    }
}
