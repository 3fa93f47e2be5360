//! Separates the two sides of walls that stand on a surface.
//!
//! A region's grid knows nothing about other surfaces: a floor that continues under a wall has
//! patches in two rooms, and light received in one would also be emitted in the other. The caller
//! casts rays to find neighbouring elements that do not see each other
//! ([`Subdivision::neighbours`], [`Subdivision::separate`]). Patches are split there, and
//! interpolation stops there. In the same way patches are split into single elements where
//! something is so close that light differs from one element to the next.

use crate::subdivision::{ElementId, Locus, Patch, PatchId, Region, Subdivision};

const NONE: u32 = u32::MAX;

/// Results of [`Subdivision::separate`]. All lists are empty if no surface has a wall.
#[derive(Debug, Default)]
pub(crate) struct Walls {
    /// For each patch, another patch of the same cell and side, or [`NONE`].
    next: Vec<u32>,
    /// For each patch, the start of its list in `joined`, or [`NONE`] if no wall is near.
    near: Vec<u32>,
    /// Lists of patches to interpolate towards: a length, then the patches in ascending order.
    joined: Vec<u32>,
    /// For each element, whether a wall is between it and a neighbour, or on it.
    beside: Vec<bool>,
    /// For each patch, cells whose element was removed (or would have been if others had remained).
    /// Empty before [`Subdivision::hide`].
    pub(crate) buried: Vec<u16>,
}

impl Walls {
    /// The patches towards which light may be interpolated from `patch`; `None` if no wall is near
    /// and all are allowed.
    #[inline]
    fn joined(&self, patch: u32) -> Option<&[u32]> {
        let at = *self.near.get(patch as usize)?;
        if at == NONE {
            return None;
        }
        let at = at as usize;
        Some(&self.joined[at + 1..at + 1 + self.joined[at] as usize])
    }

    /// The next patch in the same cell.
    #[inline]
    fn next(&self, patch: u32) -> Option<u32> {
        self.next
            .get(patch as usize)
            .copied()
            .filter(|&n| n != NONE)
    }

    /// Memory in bytes.
    pub(crate) fn bytes(&self) -> usize {
        (self.next.len() + self.near.len() + self.joined.len()) * 4
            + self.beside.len()
            + self.buried.len() * 2
    }
}

/// Column and row of a fine cell.
type Fine = [i32; 2];

impl Subdivision {
    /// Pairs of elements that are adjacent on one surface, on the same side of it, and not hidden.
    /// Loose pieces that share a cell have none.
    pub fn neighbours(&self) -> Vec<[u32; 2]> {
        self.pairs(false)
    }

    /// [`neighbours`](Self::neighbours), and pairs on either side of one hidden element, e.g. one
    /// inside a wall.
    pub fn across(&self) -> Vec<[u32; 2]> {
        self.pairs(true)
    }

    fn pairs(&self, across: bool) -> Vec<[u32; 2]> {
        let mut pairs = Vec::with_capacity(2 * self.elements().len());
        for region in self.regions.iter().filter(|r| !r.loose) {
            let [w, h] = region.fine();
            for back in 0..1 + region.two_sided as u32 {
                for r in 0..h {
                    for c in 0..w {
                        let Some(own) = self.element_at(region, [c, r], back) else {
                            continue;
                        };
                        for [dc, dr] in [[1, 0], [0, 1]] {
                            let at =
                                |n: i32| self.element_at(region, [c + n * dc, r + n * dr], back);
                            let other = at(1).or_else(|| across.then(|| at(2)).flatten());
                            pairs.extend(other.map(|other| [own, other]));
                        }
                    }
                }
            }
        }
        pairs
    }

    /// Splits patches at walls. `blocked` says of each of [`neighbours`](Self::neighbours) whether
    /// something is between the two.
    ///
    /// Patches that a wall divides become one patch per part, and those flagged in `crowded` become
    /// one per element ([`Patch::fine`]). Call it once, after [`hide`](Self::hide).
    ///
    /// # Panics
    /// If the lists differ in length.
    pub fn separate(&mut self, pairs: &[[u32; 2]], blocked: &[bool], crowded: &[bool]) {
        assert_eq!(pairs.len(), blocked.len(), "one flag per pair");
        assert_eq!(crowded.len(), self.patches.len(), "one flag per patch");
        let buried = self.walls.buried.iter().any(|b| *b != 0);
        let walls = buried || blocked.contains(&true);
        if !walls && !crowded.contains(&true) {
            return;
        }
        for (patch, crowded) in self.patches.iter_mut().zip(crowded) {
            patch.fine = *crowded && !patch.hidden && patch.elements > 1;
        }
        let mut patch_of = vec![0u32; self.elements().len()];
        for p in 0..self.patches().len() {
            patch_of[self.elements_of(PatchId(p as u32))].fill(p as u32);
        }
        let mut part = parts(pairs, blocked, &patch_of);
        for (k, (part, patch)) in part.iter_mut().zip(&patch_of).enumerate() {
            if self.patches[*patch as usize].fine {
                *part = k as u32;
            }
        }
        // An object standing on a patch may divide it too.
        let mut divided: Vec<bool> = self.walls.buried.iter().map(|b| *b != 0).collect();
        divided.resize(self.patches().len(), false);
        for (divided, patch) in divided.iter_mut().zip(&self.patches) {
            *divided |= patch.fine;
        }
        for ([a, b], _) in pairs.iter().zip(blocked).filter(|x| *x.1) {
            let p = patch_of[*a as usize];
            divided[p as usize] |= p == patch_of[*b as usize];
        }
        let moved = self.divide(&divided, &part);
        if !walls {
            return;
        }
        // Elements now have new numbers, and there are new patches.
        for p in 0..self.patches().len() {
            for k in self.elements_of(PatchId(p as u32)) {
                patch_of[k] = p as u32;
            }
        }
        let renumbered = |e: u32| moved[e as usize];
        let mut beside = vec![false; self.elements().len()];
        let mut links: Vec<[u32; 2]> = Vec::new();
        for ([a, b], blocked) in pairs.iter().zip(blocked) {
            let [a, b] = [renumbered(*a), renumbered(*b)];
            if *blocked {
                beside[a as usize] = true;
                beside[b as usize] = true;
                continue;
            }
            let [p, q] = [patch_of[a as usize], patch_of[b as usize]];
            if p != q {
                links.push([p, q]);
                links.push([q, p]);
            }
        }
        links.sort_unstable();
        links.dedup();
        self.walls.beside = self.all_beside(&beside);
        self.join(&links);
    }

    /// Splits patches into their parts; returns each element's new number.
    fn divide(&mut self, divided: &[bool], part: &[u32]) -> Vec<u32> {
        let mut moved = vec![0u32; self.elements.len()];
        let mut kept = Vec::with_capacity(self.elements.len());
        // (Patch of the first part; elements of each part with their cells), in order.
        let mut split: Vec<(u32, Vec<(u32, u16)>)> = Vec::new();
        let old = std::mem::take(&mut self.elements);
        for (p, patch) in self.patches.iter_mut().enumerate() {
            let range = patch.first_element..patch.first_element + u32::from(patch.elements);
            patch.first_element = kept.len() as u32;
            if !divided[p] || patch.hidden {
                for k in range {
                    moved[k as usize] = kept.len() as u32;
                    kept.push(old[k as usize]);
                }
                continue;
            }
            let mask = patch.mask;
            let cells = (0..16u16).filter(|b| mask >> b & 1 == 1);
            let mut members: Vec<(u32, u32, u16)> = range
                .zip(cells)
                .map(|(k, c)| (part[k as usize], k, c))
                .collect();
            members.sort_unstable();
            let mut groups: Vec<Vec<(u32, u16)>> = members
                .chunk_by(|a, b| a.0 == b.0)
                .map(|g| g.iter().map(|&(_, k, c)| (k, c)).collect())
                .collect();
            // The largest part keeps the patch's number.
            let most = (0..groups.len()).max_by_key(|&g| (groups[g].len(), std::cmp::Reverse(g)));
            let main = groups.swap_remove(most.unwrap_or(0));
            groups.sort_unstable();
            *patch = gather_part(patch, &main, &old, &mut kept, &mut moved);
            split.extend(groups.into_iter().map(|g| (p as u32, g)));
        }
        let mut next = vec![NONE; self.patches.len() + split.len()];
        for (p, members) in &split {
            let own = self.patches[*p as usize];
            let id = self.patches.len() as u32;
            let patch = gather_part(&own, members, &old, &mut kept, &mut moved);
            self.patches.push(patch);
            // Inserted before the patch's former successor.
            next[id as usize] = next[*p as usize];
            next[*p as usize] = id;
        }
        self.elements = kept;
        self.walls.next = next;
        moved
    }

    /// Marks the elements around marked or buried ones: a wall that cuts off their corner may not
    /// be between any of the sample points.
    fn all_beside(&self, marked: &[bool]) -> Vec<bool> {
        let mut beside = marked.to_vec();
        for region in self.regions.iter().filter(|r| !r.loose) {
            let ([w, h], sub) = (region.fine(), region.frame.sub as i32);
            for back in 0..1 + region.two_sided as u32 {
                for (r, c) in (0..h).flat_map(|r| (0..w).map(move |c| (r, c))) {
                    let walled = match self.element_at(region, [c, r], back) {
                        Some(e) => marked[e as usize],
                        None => {
                            let bit = 1u16 << ((r % sub) * sub + c % sub);
                            let first = self.chain(region, [c / sub, r / sub], back).next();
                            let buried = first.and_then(|p| self.walls.buried.get(p as usize));
                            buried.is_some_and(|b| b & bit != 0)
                        }
                    };
                    if !walled {
                        continue;
                    }
                    for (dr, dc) in (-1..=1).flat_map(|dr| (-1..=1).map(move |dc| (dr, dc))) {
                        if let Some(e) = self.element_at(region, [c + dc, r + dr], back) {
                            beside[e as usize] = true;
                        }
                    }
                }
            }
        }
        beside
    }

    /// Fills the lists of patches near walls: those that light can be interpolated towards without
    /// crossing a wall.
    fn join(&mut self, links: &[[u32; 2]]) {
        let count = self.patches.len();
        let mut starts = vec![0u32; count + 1];
        for l in links {
            starts[l[0] as usize + 1] += 1;
        }
        for p in 0..count {
            starts[p + 1] += starts[p];
        }
        let of = |p: u32| &links[starts[p as usize] as usize..starts[p as usize + 1] as usize];
        let near = self.near_walls();
        let (mut at, mut joined) = (vec![NONE; count], Vec::new());
        let mut list = Vec::new();
        for p in (0..count as u32).filter(|&p| near[p as usize]) {
            list.clear();
            for &[_, q] in of(p) {
                list.push(q);
                // Diagonal neighbours share no edge, so they are reached in two steps.
                list.extend(of(q).iter().map(|l| l[1]).filter(|&r| r != p));
            }
            list.sort_unstable();
            list.dedup();
            at[p as usize] = joined.len() as u32;
            joined.push(list.len() as u32);
            joined.extend(&list);
        }
        self.walls.near = at;
        self.walls.joined = joined;
    }

    /// Patches in or next to a cell that has an element beside a wall.
    fn near_walls(&self) -> Vec<bool> {
        let mut near = vec![false; self.patches.len()];
        for region in self.regions.iter().filter(|r| !r.loose) {
            let [w, h] = region.frame.cells.map(|x| x as i32);
            for back in 0..1 + region.two_sided as u32 {
                for (r, c) in (0..h).flat_map(|r| (0..w).map(move |c| (r, c))) {
                    let walled = self
                        .chain(region, [c, r], back)
                        .any(|p| self.elements_of(PatchId(p)).any(|k| self.walls.beside[k]));
                    if !walled {
                        continue;
                    }
                    for (dr, dc) in (-1..=1).flat_map(|dr| (-1..=1).map(move |dc| (dr, dc))) {
                        for p in self.chain(region, [c + dc, r + dr], back) {
                            near[p as usize] = true;
                        }
                    }
                }
            }
        }
        near
    }

    /// The patches of a cell on one side; none outside the grid.
    pub(crate) fn chain(
        &self,
        region: &Region,
        cell: Fine,
        back: u32,
    ) -> impl Iterator<Item = u32> + '_ {
        let [w, h] = region.frame.cells.map(|x| x as i32);
        let inside = cell[0] >= 0 && cell[1] >= 0 && cell[0] < w && cell[1] < h;
        let front = if inside {
            self.tables[region.table + (cell[1] * w + cell[0]) as usize]
        } else {
            NONE
        };
        let first = (front != NONE).then(|| front + back);
        std::iter::successors(first, |&p| self.walls.next(p))
    }

    /// The element of a fine cell on one side, unless it is hidden.
    fn element_at(&self, region: &Region, fine: Fine, back: u32) -> Option<u32> {
        if fine[0] < 0 || fine[1] < 0 {
            return None;
        }
        let sub = region.frame.sub as i32;
        let bit = 1u16 << ((fine[1] % sub) * sub + fine[0] % sub);
        self.chain(region, [fine[0] / sub, fine[1] / sub], back)
            .map(|p| &self.patches[p as usize])
            .find_map(|p| p.element_of(bit).filter(|_| !p.hidden))
    }

    /// The patch for a point in fine cell `bit`, among the chain of the cell at `front`: the patch
    /// with an element there, else the one with the nearest element.
    #[inline]
    pub(crate) fn of_chain(&self, first: u32, bit: u16, sub: u32) -> u32 {
        if self.walls.next(first).is_none() {
            return first;
        }
        let chain = || std::iter::successors(Some(first), |&p| self.walls.next(p));
        if let Some(p) = chain().find(|&p| self.patches[p as usize].mask & bit != 0) {
            return p;
        }
        let place = |bit: u32| [(bit % sub) as i32, (bit / sub) as i32];
        let own = place(bit.trailing_zeros());
        let distance = |p: u32| {
            let mask = self.patches[p as usize].mask;
            (0..16u32)
                .filter(|b| mask >> b & 1 == 1)
                .map(|b| {
                    let at = place(b);
                    (at[0] - own[0]).pow(2) + (at[1] - own[1]).pow(2)
                })
                .min()
        };
        chain()
            .min_by_key(|&p| (distance(p).unwrap_or(i32::MAX), p))
            .unwrap_or(first)
    }

    /// The patch of the cell whose chain begins with `first` that interpolation from `patch` may
    /// reach, if any.
    #[inline]
    pub(crate) fn reached(&self, patch: u32, first: u32) -> Option<u32> {
        let Some(joined) = self.walls.joined(patch) else {
            return Some(first);
        };
        let chain = || std::iter::successors(Some(first), |&p| self.walls.next(p));
        if chain().any(|p| p == patch) {
            return Some(patch);
        }
        chain().find(|p| joined.binary_search(p).is_ok())
    }

    /// Whether any surface has walls, as passed to [`separate`](Self::separate).
    #[inline]
    pub fn has_walls(&self) -> bool {
        !self.walls.beside.is_empty()
    }

    /// Like `at`, but on the correct side of a wall. `sees` says whether nothing is between the
    /// point and an element's point; it is only called if a wall is beside the element.
    pub fn on_this_side(
        &self,
        triangle: u32,
        p: glam::Vec3,
        at: Locus,
        sees: impl Fn(&crate::Element) -> bool,
    ) -> Locus {
        // A point beside a body may be in a cell whose own point is in the body.
        let hidden = self.patches[at.patch.0 as usize].hidden;
        if !hidden && (!self.has_walls() || self.walls.joined(at.patch.0).is_none()) {
            return at;
        }
        if let Some(e) = at.element.filter(|_| !hidden)
            && (!self.walls.beside[e.0 as usize] || sees(&self.elements[e.0 as usize]))
        {
            return at;
        }
        // Already tested by the caller; no need to test it again.
        let unseen = at.element.map(|e| e.0);
        let region = &self.regions[self.region_of_triangle[triangle as usize] as usize];
        let back = self.patches[at.patch.0 as usize].back as u32;
        let sub = region.frame.sub as f32;
        let q = region.frame.project(p).map(|x| x * sub);
        let [w, h] = region.fine();
        let own = [(q[0] as i32).clamp(0, w - 1), (q[1] as i32).clamp(0, h - 1)];
        // Nearest first. Equal distances are ordered by cell.
        let mut around = [(0.0f32, [0; 2]); 9];
        for (k, slot) in around.iter_mut().enumerate() {
            let f: Fine = [own[0] + k as i32 % 3 - 1, own[1] + k as i32 / 3 - 1];
            let d = [f[0] as f32 + 0.5 - q[0], f[1] as f32 + 0.5 - q[1]];
            *slot = (d[0] * d[0] + d[1] * d[1], f);
        }
        around.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (_, fine) in around {
            let cell = [
                fine[0].div_euclid(sub as i32),
                fine[1].div_euclid(sub as i32),
            ];
            if fine[0] < 0 || fine[1] < 0 {
                continue;
            }
            let bit = 1u16 << ((fine[1] % sub as i32) * sub as i32 + fine[0] % sub as i32);
            for patch in self.chain(region, cell, back) {
                if let Some(e) = self.patches[patch as usize].element_of(bit)
                    && Some(e) != unseen
                    && !self.patches[patch as usize].hidden
                    && sees(&self.elements[e as usize])
                {
                    return Locus {
                        patch: PatchId(patch),
                        element: Some(ElementId(e)),
                    };
                }
            }
        }
        at
    }
}

/// Numbers the parts into which walls split patches: connected elements of one patch have the same
/// number.
fn parts(pairs: &[[u32; 2]], blocked: &[bool], patch_of: &[u32]) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..patch_of.len() as u32).collect();
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    for ([a, b], blocked) in pairs.iter().zip(blocked) {
        if !blocked && patch_of[*a as usize] == patch_of[*b as usize] {
            let (a, b) = (root(&mut parent, *a), root(&mut parent, *b));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    (0..patch_of.len() as u32)
        .map(|i| root(&mut parent, i))
        .collect()
}

/// A patch of some elements (number, cell) of `whole`, which are appended to `kept`.
fn gather_part(
    whole: &Patch,
    members: &[(u32, u16)],
    old: &[crate::Element],
    kept: &mut Vec<crate::Element>,
    moved: &mut [u32],
) -> Patch {
    let mut patch = Patch {
        first_element: kept.len() as u32,
        elements: members.len() as u16,
        mask: 0,
        area: 0.0,
        // Unique, because patch numbers only reach this bit in scenes of hundreds of millions of
        // patches.
        name: whole.name ^ (u32::from(members[0].1) + 1) << 27,
        ..*whole
    };
    for &(k, cell) in members {
        moved[k as usize] = kept.len() as u32;
        kept.push(old[k as usize]);
        patch.mask |= 1 << cell;
        patch.area += old[k as usize].area;
    }
    patch
}

#[cfg(test)]
mod tests;
