//! Joins small charts to their neighbours by moving and rotating one so that their common border
//! coincides.
//!
//! Every chart pays for the texels that lookups read beyond it; a chart of 5 × 5 texels pays as
//! much again as it covers. Joined charts share these texels. Nothing is stretched and nothing
//! overlaps; if the common border does not fit exactly, the charts are moved apart by a fraction of
//! a texel.
//!
//! Charts that fold around each other would have other common borders one or two lumels apart.
//! These are slits, whose two sides read the same texels and cannot be stitched. Charts stay
//! separate if too much of a border would become a slit.

use glam::DVec2;

use super::charts::{Charts, cross2};
use super::input::UnwrapInput;
use super::joints::{Joint, joints};

/// Largest chart that is joined to another, lumels². Larger charts would save few texels in
/// relation to their size.
const SMALL: f64 = 256.0;

/// A smooth or flat border joins two charts if it is at least this long, relative to the side of a
/// square with the smaller chart's area.
const LEAST_BORDER: f64 = 0.2;

/// Charts are joined across a hard edge if together they are at most this large, lumels²: within
/// one lumel there is only one value anyway.
const TINY: f64 = 1.0;

/// Most triangles of the smaller and of the larger chart: the overlap test visits both.
const MOST_TRIANGLES: [usize; 2] = [2048, 8192];

/// Largest fraction of the common border that may become slits, relative to the border at which
/// they are joined. Without a limit, seams of Sponza differ by 57 % (99th percentile), with this
/// one by 24 %. With 0 they differ by 26 %, and charts cover 1.4 % less of the page.
const SLITS: f64 = 0.3;

/// Widths of slits in lumels: narrower ones are welded, and the sides of wider ones read different
/// texels.
const SLIT: [f64; 2] = [0.5, 2.0];

/// Distances by which two charts are moved apart before they are left separate, in lumels or sides
/// of the smaller one.
const SHIFTS: [f64; 4] = [0.0, 0.02, 0.1, 0.3];

/// Joins charts of `mesh`; a lumel is `lumel` metres wide.
pub(super) fn join_small(mesh: &UnwrapInput, charts: &mut Charts, lumel: f64) {
    if !(lumel > 0.0 && lumel.is_finite()) {
        return;
    }
    let mut all = joints(mesh, charts);
    // By pair; hard joints count only if there are no others.
    all.sort_by(|a, b| {
        (a.charts, a.hard)
            .cmp(&(b.charts, b.hard))
            .then(b.length.total_cmp(&a.length))
    });
    let mut pairs: Vec<Pair<'_>> = Vec::new();
    for run in all.chunk_by(|a, b| a.charts == b.charts) {
        let soft = run.iter().take_while(|j| !j.hard).count();
        let list = if soft > 0 { &run[..soft] } else { run };
        pairs.push(Pair {
            joints: list,
            length: list.iter().map(|j| j.length).sum(),
        });
    }
    // Longest common border first, hard edges last.
    pairs.sort_by(|a, b| {
        let hard = |p: &Pair<'_>| p.joints[0].hard;
        (hard(a).cmp(&hard(b)))
            .then(b.length.total_cmp(&a.length))
            .then(a.joints[0].charts.cmp(&b.joints[0].charts))
    });
    let mut islands = Islands::new(charts, &all);
    // Twice, because an obstacle may have moved in the first pass.
    for _ in 0..2 {
        for pair in &pairs {
            islands.try_join(pair, lumel);
        }
    }
    islands.write(charts);
}

/// The common border of two charts.
struct Pair<'a> {
    joints: &'a [Joint],
    length: f64,
}

/// A rotation and a translation.
#[derive(Debug, Clone, Copy)]
struct Motion {
    /// Cosine and sine of the angle.
    turn: DVec2,
    shift: DVec2,
}

impl Motion {
    const NONE: Motion = Motion {
        turn: DVec2::X,
        shift: DVec2::ZERO,
    };

    fn apply(&self, p: DVec2) -> DVec2 {
        self.turn.rotate(p) + self.shift
    }

    /// First `self`, then `next`.
    fn then(&self, next: &Motion) -> Motion {
        Motion {
            turn: next.turn.rotate(self.turn).normalize_or(DVec2::X),
            shift: next.apply(self.shift),
        }
    }

    /// The motion that takes the second of each pair of points nearest to the first (weighted least
    /// squares).
    fn fit(points: &[(DVec2, DVec2, f64)]) -> Motion {
        let total: f64 = points.iter().map(|p| p.2).sum();
        let mean = |f: fn(&(DVec2, DVec2, f64)) -> DVec2| {
            points.iter().map(|p| f(p) * p.2).sum::<DVec2>() / total.max(f64::MIN_POSITIVE)
        };
        let (to, from) = (mean(|p| p.0), mean(|p| p.1));
        let mut turn = DVec2::ZERO;
        for (a, b, w) in points {
            let (a, b) = (*a - to, *b - from);
            turn += DVec2::new(a.dot(b), b.perp_dot(a)) * *w;
        }
        let turn = turn.normalize_or(DVec2::X);
        Motion {
            turn,
            shift: to - turn.rotate(from),
        }
    }
}

/// Charts joined so far.
struct Islands {
    /// Island of each chart, as the index of one of its charts (union–find with path halving).
    parent: Vec<u32>,
    /// Motion from each chart's own coordinates to its island's.
    motion: Vec<Motion>,
    /// Charts of each root.
    members: Vec<Vec<u32>>,
    /// Triangles of each root, in the island's coordinates.
    triangles: Vec<Vec<[DVec2; 3]>>,
    /// Area of each root, m².
    area: Vec<f64>,
    /// Joints of each chart that are not hard.
    soft: Vec<Vec<Joint>>,
}

impl Islands {
    fn new(charts: &Charts, joints: &[Joint]) -> Islands {
        let count = charts.count as usize;
        let mut triangles: Vec<Vec<[DVec2; 3]>> = vec![Vec::new(); count];
        let mut area = vec![0.0; count];
        for (c, &chart) in charts.corners.iter().zip(&charts.chart) {
            // Collapsed triangles take no space.
            if cross2(c) > 0.0 {
                triangles[chart as usize].push(*c);
                area[chart as usize] += 0.5 * cross2(c);
            }
        }
        let mut soft = vec![Vec::new(); count];
        for joint in joints.iter().filter(|j| !j.hard) {
            for chart in joint.charts {
                soft[chart as usize].push(*joint);
            }
        }
        Islands {
            parent: (0..charts.count).collect(),
            motion: vec![Motion::NONE; count],
            members: (0..charts.count).map(|c| vec![c]).collect(),
            triangles,
            area,
            soft,
        }
    }

    fn root(&mut self, mut c: u32) -> u32 {
        while self.parent[c as usize] != c {
            let up = self.parent[self.parent[c as usize] as usize];
            self.parent[c as usize] = up;
            c = up;
        }
        c
    }

    fn try_join(&mut self, pair: &Pair<'_>, lumel: f64) {
        let charts = pair.joints[0].charts;
        let roots = charts.map(|c| self.root(c));
        if roots[0] == roots[1] {
            return;
        }
        let area = roots.map(|r| self.area[r as usize] / (lumel * lumel));
        // Side 0 stays; side 1, the smaller one, moves.
        let (stay, go) = if area[0] >= area[1] { (0, 1) } else { (1, 0) };
        let sizes = [go, stay].map(|s| self.triangles[roots[s] as usize].len());
        if area[go] > SMALL || sizes[0] > MOST_TRIANGLES[0] || sizes[1] > MOST_TRIANGLES[1] {
            return;
        }
        let side = area[go].max(0.0).sqrt();
        if pair.joints[0].hard {
            if area[0] + area[1] > TINY {
                return;
            }
        } else if side > 1.0 && pair.length < LEAST_BORDER * side * lumel {
            return;
        }
        let unit = lumel * side.min(1.0);
        let points = |joints: &[Joint]| -> Vec<(DVec2, DVec2, f64)> {
            joints
                .iter()
                .flat_map(|j| {
                    let place =
                        |s: usize, e: usize| self.motion[charts[s] as usize].apply(j.ends[s][e]);
                    [0, 1].map(|e| (place(stay, e), place(go, e), j.length))
                })
                .collect()
        };
        // Fitted to the longest edge first, then to all joints that fit nearly as well.
        let mut motion = Motion::fit(&points(&pair.joints[..1]));
        let near: Vec<(DVec2, DVec2, f64)> = points(pair.joints)
            .into_iter()
            .filter(|p| motion.apply(p.1).distance(p.0) < 0.25 * unit)
            .collect();
        if near.len() > 2 {
            motion = Motion::fit(&near);
        }
        // Moved away from the island that stays. A triangle of positive area is on the `perp` side
        // of its edges, and the joint runs in the direction of the lower chart.
        let edge = points(&pair.joints[..1]);
        let Some(along) = (edge[1].0 - edge[0].0).try_normalize() else {
            return;
        };
        let out = if stay == 0 {
            -along.perp()
        } else {
            along.perp()
        };
        let limit = (1.5e-3 * lumel).min(0.02 * side * lumel);
        for shift in SHIFTS {
            let mut moved = motion;
            moved.shift += out * (shift * unit);
            if self.slits([roots[stay], roots[go]], &moved, lumel) > SLITS * pair.length {
                return;
            }
            let placed: Vec<[DVec2; 3]> = self.triangles[roots[go] as usize]
                .iter()
                .map(|c| c.map(|p| moved.apply(p)))
                .collect();
            if !overlap(&placed, &self.triangles[roots[stay] as usize], limit) {
                self.merge(roots[stay], roots[go], &moved, placed);
                return;
            }
        }
    }

    /// Total length of the slits between two roots after the motion of the second, metres.
    fn slits(&mut self, [stay, go]: [u32; 2], motion: &Motion, lumel: f64) -> f64 {
        let mut length = 0.0;
        for m in 0..self.members[go as usize].len() {
            let chart = self.members[go as usize][m];
            for j in 0..self.soft[chart as usize].len() {
                let joint = self.soft[chart as usize][j];
                let side = usize::from(joint.charts[1] == chart);
                let other = joint.charts[1 - side];
                if self.root(other) != stay {
                    continue;
                }
                let [gap, beyond] = [0, 1].map(|end| {
                    let moved = self.motion[chart as usize].apply(joint.ends[side][end]);
                    let theirs = self.motion[other as usize].apply(joint.ends[1 - side][end]);
                    motion.apply(moved).distance(theirs) / lumel
                });
                if gap.max(beyond) > SLIT[0] && gap.min(beyond) < SLIT[1] {
                    length += joint.length;
                }
            }
        }
        length
    }

    fn merge(&mut self, stay: u32, go: u32, motion: &Motion, placed: Vec<[DVec2; 3]>) {
        let (stay, go) = (stay as usize, go as usize);
        self.parent[go] = stay as u32;
        for c in std::mem::take(&mut self.members[go]) {
            self.motion[c as usize] = self.motion[c as usize].then(motion);
            self.members[stay].push(c);
        }
        self.triangles[go] = Vec::new();
        self.triangles[stay].extend(placed);
        self.area[stay] += self.area[go];
    }

    fn write(mut self, charts: &mut Charts) {
        for (corners, chart) in charts.corners.iter_mut().zip(&mut charts.chart) {
            let motion = self.motion[*chart as usize];
            *corners = corners.map(|p| motion.apply(p));
            *chart = self.root(*chart);
        }
        charts.renumber();
    }
}

fn bounds(c: &[DVec2; 3]) -> (DVec2, DVec2) {
    (c[0].min(c[1]).min(c[2]), c[0].max(c[1]).max(c[2]))
}

/// Whether any triangle of `some` overlaps any of `others` by more than `limit`.
fn overlap(some: &[[DVec2; 3]], others: &[[DVec2; 3]], limit: f64) -> bool {
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for c in some {
        let (a, b) = bounds(c);
        low = low.min(a);
        high = high.max(b);
    }
    let near: Vec<&[DVec2; 3]> = others
        .iter()
        .filter(|c| {
            let (a, b) = bounds(c);
            a.cmplt(high - limit).all() && b.cmpgt(low + limit).all()
        })
        .collect();
    if near.is_empty() {
        return false;
    }
    // A grid over the smaller chart with about one triangle per cell.
    let n = (some.len() as f64).sqrt().ceil().clamp(1.0, 64.0);
    let cell = ((high - low) / n).max(DVec2::splat(f64::MIN_POSITIVE));
    let cells = |c: &[DVec2; 3]| {
        let (a, b) = bounds(c);
        let index = |p: DVec2| {
            ((p - low) / cell)
                .clamp(DVec2::ZERO, DVec2::splat(n - 1.0))
                .as_uvec2()
        };
        let (a, b) = (index(a), index(b));
        (a.y..=b.y).flat_map(move |y| (a.x..=b.x).map(move |x| (y * n as u32 + x) as usize))
    };
    let mut grid: Vec<Vec<u32>> = vec![Vec::new(); (n * n) as usize];
    for (i, c) in some.iter().enumerate() {
        for cell in cells(c) {
            grid[cell].push(i as u32);
        }
    }
    near.iter().any(|other| {
        cells(other).any(|cell| {
            grid[cell]
                .iter()
                .any(|&i| depth(&some[i as usize], other) > limit)
        })
    })
}

/// Penetration depth of two triangles along the axis where it is smallest (separating axes);
/// negative if they are disjoint.
fn depth(a: &[DVec2; 3], b: &[DVec2; 3]) -> f64 {
    let mut least = f64::INFINITY;
    for (c, k) in [a, b].into_iter().flat_map(|c| (0..3).map(move |k| (c, k))) {
        let Some(axis) = (c[(k + 1) % 3] - c[k]).perp().try_normalize() else {
            continue;
        };
        let range = |t: &[DVec2; 3]| {
            let d = t.map(|p| p.dot(axis));
            (d[0].min(d[1]).min(d[2]), d[0].max(d[1]).max(d[2]))
        };
        let ((a0, a1), (b0, b1)) = (range(a), range(b));
        least = least.min((a1 - b0).min(b1 - a0));
        if least <= 0.0 {
            break;
        }
    }
    least
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// A flat cone of three triangles, 6 m from tip to rim, whose angles at the tip fall short of a
    /// full turn by `missing`. Each triangle is a chart.
    fn cone(missing: f64) -> (UnwrapInput, Charts) {
        let (side, angle) = (6.0, (std::f64::consts::TAU - missing) / 3.0);
        let radius = 2.0 * side * (0.5 * angle).sin() / 3f64.sqrt();
        let height = (side * side - radius * radius).sqrt();
        let rim = |k: u32| {
            let turn = f64::from(k) * std::f64::consts::TAU / 3.0;
            Vec3::new(
                (radius * turn.cos()) as f32,
                (radius * turn.sin()) as f32,
                0.0,
            )
        };
        let mesh = UnwrapInput {
            positions: vec![Vec3::Z * height as f32, rim(0), rim(1), rim(2)],
            triangles: vec![[0, 1, 2], [0, 2, 3], [0, 3, 1]],
            primitive: vec![0; 3],
            seams: vec![[false; 3]; 3],
            // From the tip, along the rim, back to the tip.
            neighbors: vec![[2, u32::MAX, 1], [0, u32::MAX, 2], [1, u32::MAX, 0]],
        };
        let flat = [
            DVec2::ZERO,
            DVec2::X * side,
            DVec2::from_angle(angle) * side,
        ];
        let charts = Charts {
            corners: vec![flat; 3],
            chart: vec![0, 1, 2],
            count: 3,
        };
        (mesh, charts)
    }

    #[test]
    fn charts_that_would_leave_a_slit_stay_apart() {
        // Distance between the third border's ends in lumels: zero, welded, twice what lookups
        // share, and nearly all of it.
        for (apart, count) in [(0.0, 1), (0.3, 1), (1.2, 2), (1.8, 2), (6.0, 2)] {
            let (mesh, mut charts) = cone(apart / 6.0);
            join_small(&mesh, &mut charts, 1.0);
            assert_eq!(charts.count, count, "{apart}");
        }
    }
}
