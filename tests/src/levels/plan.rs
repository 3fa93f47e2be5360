//! Floor plans: rooms on a grid with typical walls, and their contents.

use glam::Vec3;

use super::kit::{Kit, place};
use super::shapes::{self, Palette, Parts, block, bounds};
use crate::geometry::{Geometry, quad};
use crate::gltf::Light;

/// How wall pieces meet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Joint {
    /// They intersect.
    Overlap,
    /// Face to face.
    Abut,
    /// They fall short by a millimetre.
    Short,
}

/// What is between two rooms, or a room and the outside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Edge {
    Open,
    Wall,
    /// A doorway this wide.
    Door(f32),
    /// This many windows, from the first height to the second.
    Windows(u32, f32, f32),
}

/// Construction style of a plan.
#[derive(Debug, Clone, Copy)]
pub(super) struct Style {
    pub thickness: f32,
    pub joint: Joint,
    /// Walls, floors and ceilings are inward-facing planes; inner walls are double-sided planes.
    pub skins: bool,
    pub double_sided: bool,
    /// A floor and a ceiling for each room.
    pub per_room: bool,
    /// Whether walls are one piece over several rooms if possible.
    pub long: bool,
    pub ceiling: bool,
}

impl Style {
    pub fn draw(kit: &mut Kit) -> Style {
        let rng = &mut kit.rng;
        Style {
            thickness: rng.pick(&[0.01, 0.02, 0.05, 0.1, 0.1, 0.15, 0.2, 0.3, 0.4]),
            joint: rng.pick(&[Joint::Overlap, Joint::Overlap, Joint::Abut, Joint::Short]),
            skins: rng.chance(0.15),
            double_sided: rng.chance(0.5),
            per_room: rng.chance(0.4),
            long: rng.chance(0.6),
            ceiling: true,
        }
    }
}

/// A hole in a wall that was built.
#[derive(Debug, Clone, Copy)]
pub(super) struct Opening {
    /// Middle of the hole's bottom, on the wall's middle plane.
    pub at: Vec3,
    /// The wall runs along x, else along z.
    pub along_x: bool,
    pub width: f32,
    pub height: f32,
    pub window: bool,
    /// −1 if the outside is on the side of smaller coordinates; 1 otherwise.
    pub outwards: f32,
    pub thickness: f32,
}

impl Opening {
    /// Places parts modelled in the hole's own frame: x along the wall, z inwards.
    pub fn place(&self) -> super::kit::Place {
        let turn = match (self.along_x, self.outwards < 0.0) {
            (true, true) => 0.0,
            (true, false) => 180.0,
            (false, true) => 90.0,
            (false, false) => 270.0,
        };
        place(self.at, turn)
    }
}

/// Free space between walls.
#[derive(Debug, Clone)]
pub(super) struct Room {
    pub min: Vec3,
    pub max: Vec3,
    /// Rectangles on the floor that are taken: x and z from, to.
    pub taken: Vec<[f32; 4]>,
}

/// A plan before it is built.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub xs: Vec<f32>,
    pub zs: Vec<f32>,
    pub floor: f32,
    pub height: f32,
    /// `[line][segment]`: walls along x on each line of `zs`.
    pub along_x: Vec<Vec<Edge>>,
    /// Walls along z on each line of `xs`.
    pub along_z: Vec<Vec<Edge>>,
    pub style: Style,
    pub wall: usize,
    pub ground: usize,
    pub top: usize,
}

/// The result of building a plan.
#[derive(Debug, Clone, Default)]
pub(super) struct Built {
    /// Row by row, x fastest.
    pub rooms: Vec<Room>,
    pub openings: Vec<Opening>,
}

impl Plan {
    /// Closed rooms with doors between all neighbours; the centre of the first corner is at the
    /// origin.
    pub fn draw(kit: &mut Kit, cells: [u32; 2], side: [f32; 2], height: f32) -> Plan {
        let style = Style::draw(kit);
        let rng = &mut kit.rng;
        let mut lines = |n: u32| {
            let mut at = vec![0.0];
            for i in 0..n as usize {
                at.push(at[i] + rng.metres(side[0], side[1]));
            }
            at
        };
        let (xs, zs) = (lines(cells[0]), lines(cells[1]));
        let edges = |lines: usize, segments: u32, rng: &mut super::random::Random| {
            (0..lines)
                .map(|j| {
                    let outer = j == 0 || j + 1 == lines;
                    (0..segments)
                        .map(|_| {
                            if outer {
                                Edge::Wall
                            } else {
                                Edge::Door(rng.metres(0.8, 1.4))
                            }
                        })
                        .collect()
                })
                .collect::<Vec<Vec<Edge>>>()
        };
        let along_x = edges(zs.len(), cells[0], rng);
        let along_z = edges(xs.len(), cells[1], rng);
        Plan {
            xs,
            zs,
            floor: 0.0,
            height,
            along_x,
            along_z,
            style,
            wall: 0,
            ground: 0,
            top: 0,
        }
    }

    /// Draws paints: walls around `level`, floors darker.
    pub fn paint(&mut self, kit: &mut Kit, level: [f32; 2], spread: f32) {
        let both = self.style.double_sided;
        let wall = kit.rng.range(level[0], level[1]);
        let rho = kit.rng.colour(wall, spread);
        self.wall = kit.paint_sided("wall", rho, both);
        let level = kit.rng.range(0.2, level[1] * 0.8);
        let rho = kit.rng.colour(level, spread + 0.1);
        self.ground = kit.paint_sided("floor", rho, both);
        let level = if wall > 0.9 {
            wall
        } else {
            kit.rng.range(0.6, 0.9)
        };
        let rho = kit.rng.colour(level, 0.02);
        self.top = kit.paint_sided("ceiling", rho, both);
    }

    /// Builds it at the origin.
    pub fn build(&self, kit: &mut Kit) -> Built {
        let mut out = Built::default();
        let double = if self.style.skins {
            let rho = kit.rng.colour(0.7, 0.05);
            Some(kit.paint_sided("partition", rho, true))
        } else {
            None
        };
        for along_x in [true, false] {
            let lines = if along_x {
                &self.along_x
            } else {
                &self.along_z
            };
            for (j, edges) in lines.iter().enumerate() {
                let mut from = 0;
                while from < edges.len() {
                    if edges[from] == Edge::Open {
                        from += 1;
                        continue;
                    }
                    let mut to = from + 1;
                    while self.style.long && to < edges.len() && edges[to] != Edge::Open {
                        to += 1;
                    }
                    self.wall(kit, &mut out, along_x, j, [from, to], double);
                    from = to;
                }
            }
        }
        self.floors(kit);
        let t = if self.style.skins {
            0.0
        } else {
            self.style.thickness
        };
        for z in self.zs.windows(2) {
            for x in self.xs.windows(2) {
                let h = Vec3::splat(t / 2.0).with_y(0.0);
                let min = Vec3::new(x[0], self.floor, z[0]) + h;
                let max = Vec3::new(x[1], self.floor + self.height, z[1]) - h;
                let inset = Vec3::new(0.4, 0.0, 0.4);
                kit.space(min + inset, max - inset);
                out.rooms.push(Room {
                    min,
                    max,
                    taken: Vec::new(),
                });
            }
        }
        // Nothing stands in doorways.
        for o in &out.openings {
            if o.window {
                continue;
            }
            let (a, b) = if o.along_x {
                (o.width / 2.0, 0.9)
            } else {
                (0.9, o.width / 2.0)
            };
            for r in &mut out.rooms {
                r.taken
                    .push([o.at.x - a, o.at.x + a, o.at.z - b, o.at.z + b]);
            }
        }
        out
    }

    /// A run of wall with its holes.
    fn wall(
        &self,
        kit: &mut Kit,
        out: &mut Built,
        along_x: bool,
        line: usize,
        run: [usize; 2],
        double: Option<usize>,
    ) {
        let (along, across, all) = if along_x {
            (&self.xs, &self.zs, &self.along_x)
        } else {
            (&self.zs, &self.xs, &self.along_z)
        };
        let s = &self.style;
        let outer = line == 0 || line + 1 == across.len();
        let t = s.thickness;
        let end = match s.joint {
            _ if s.skins => 0.0,
            Joint::Overlap => t / 2.0,
            Joint::Abut | Joint::Short => {
                let gap = if s.joint == Joint::Short { 0.001 } else { 0.0 };
                if along_x && outer {
                    t / 2.0
                } else {
                    -t / 2.0 - gap
                }
            }
        };
        let (from, to) = (along[run[0]] - end, along[run[1]] + end);
        let (y0, y1) = (self.floor, self.floor + self.height);
        let (base, head) = match s.joint {
            Joint::Overlap if !s.skins => (y0 - t * 0.5, y1 + t * 0.5),
            Joint::Short if !s.skins => (y0 + 0.001, y1 - 0.001),
            _ => (y0, y1),
        };
        // Holes: from, to, sill, head.
        let mut holes: Vec<([f32; 4], bool)> = Vec::new();
        for k in run[0]..run[1] {
            let (a, b) = (along[k], along[k + 1]);
            match all[line][k] {
                Edge::Door(w) => {
                    let middle = a + (b - a) * kit.rng.range(0.35, 0.65);
                    let top = (y0 + 2.05).min(y1 - 0.15);
                    holes.push(([middle - w / 2.0, middle + w / 2.0, base, top], false));
                }
                Edge::Windows(n, sill, top) => {
                    let share = kit.rng.range(0.45, 0.75);
                    for i in 0..n {
                        let middle = a + (b - a) * (i as f32 + 0.5) / n as f32;
                        let w = (b - a) / n as f32 * share;
                        let hole = [middle - w / 2.0, middle + w / 2.0, y0 + sill, y0 + top];
                        holes.push((hole, true));
                    }
                }
                Edge::Open | Edge::Wall => {}
            }
        }
        let mut pieces: Vec<[f32; 4]> = Vec::new();
        let mut at = from;
        for (h, window) in &holes {
            pieces.push([at, h[0], base, head]);
            pieces.push([h[0], h[1], h[3], head]);
            if h[2] > base {
                pieces.push([h[0], h[1], base, h[2]]);
            }
            at = h[1];
            let outwards = if line == 0 { -1.0 } else { 1.0 };
            let middle = (h[0] + h[1]) / 2.0;
            let y = h[2].max(y0);
            out.openings.push(Opening {
                at: if along_x {
                    Vec3::new(middle, y, across[line])
                } else {
                    Vec3::new(across[line], y, middle)
                },
                along_x,
                width: h[1] - h[0],
                height: h[3] - y,
                window: *window,
                outwards,
                thickness: if s.skins { 0.0 } else { t },
            });
        }
        pieces.push([at, to, base, head]);
        let together = kit.rng.chance(0.5);
        let mut joined = Geometry::default();
        let paint = match double {
            Some(p) if !outer => p,
            _ => self.wall,
        };
        for (k, [a, b, c, d]) in pieces.into_iter().enumerate() {
            if b - a < 1e-4 || d - c < 1e-4 {
                continue;
            }
            let g = if s.skins {
                self.skin(
                    along_x,
                    across[line],
                    line + 1 == across.len(),
                    [a, b, c, d],
                )
            } else if along_x {
                let z = across[line];
                block([a, c, z - t / 2.0], [b, d, z + t / 2.0])
            } else {
                let x = across[line];
                block([x - t / 2.0, c, a], [x + t / 2.0, d, b])
            };
            if together {
                joined.append(&g);
            } else {
                let axis = if along_x { 'x' } else { 'z' };
                let name = format!("wall_{axis}{line}_{}_{k}", run[0]);
                kit.part(&name, &g, paint);
            }
        }
        if !joined.triangles.is_empty() {
            let axis = if along_x { 'x' } else { 'z' };
            kit.part(&format!("wall_{axis}{line}_{}", run[0]), &joined, paint);
        }
    }

    /// A plane of wall whose front looks towards larger coordinates, or on the last line to smaller
    /// ones.
    fn skin(&self, along_x: bool, at: f32, last: bool, [a, b, c, d]: [f32; 4]) -> Geometry {
        let p = |s: f32, y: f32| {
            if along_x {
                Vec3::new(s, y, at)
            } else {
                Vec3::new(at, y, s)
            }
        };
        let g = quad([p(a, c), p(b, c), p(b, d), p(a, d)]);
        if along_x == last { g.flipped() } else { g }
    }

    fn floors(&self, kit: &mut Kit) {
        let s = &self.style;
        let t = s.thickness;
        let end = match s.joint {
            Joint::Overlap => t / 2.0,
            Joint::Abut => t / 2.0,
            Joint::Short => -t / 2.0 - 0.001,
        };
        let slab = |x: [f32; 2], z: [f32; 2], y: f32, up: bool| {
            if s.skins {
                let p = |x: f32, z: f32| Vec3::new(x, y, z);
                let q = [p(x[0], z[0]), p(x[0], z[1]), p(x[1], z[1]), p(x[1], z[0])];
                let g = quad(q);
                return if up { g } else { g.flipped() };
            }
            let (low, high) = if up { (y - t, y) } else { (y, y + t) };
            block(
                [x[0] - end, low, z[0] - end],
                [x[1] + end, high, z[1] + end],
            )
        };
        let (first, last) = (
            [self.xs[0], self.zs[0]],
            [self.xs[self.xs.len() - 1], self.zs[self.zs.len() - 1]],
        );
        let mut pieces = Vec::new();
        if s.per_room {
            for z in self.zs.windows(2) {
                for x in self.xs.windows(2) {
                    pieces.push(([x[0], x[1]], [z[0], z[1]]));
                }
            }
        } else {
            pieces.push(([first[0], last[0]], [first[1], last[1]]));
        }
        for (k, (x, z)) in pieces.into_iter().enumerate() {
            let floor = slab(x, z, self.floor, true);
            kit.part(&format!("floor_{k}"), &floor, self.ground);
            if s.ceiling {
                let top = slab(x, z, self.floor + self.height, false);
                kit.part(&format!("ceiling_{k}"), &top, self.top);
            }
        }
    }
}

impl Room {
    /// Area of floor, walls and ceiling, m².
    pub fn surface(&self) -> f32 {
        let d = self.max - self.min;
        2.0 * (d.x * d.z + d.x * d.y + d.y * d.z)
    }

    fn overlaps(&self, r: [f32; 4]) -> bool {
        let meets = |t: &[f32; 4]| r[0] < t[1] && t[0] < r[1] && r[2] < t[3] && t[2] < r[3];
        self.taken.iter().any(meets)
    }

    /// Puts parts against a wall (`gap` in front of it; negative: into it) or anywhere, `lift`
    /// above the floor, if there is space.
    pub fn stand(
        &mut self,
        kit: &mut Kit,
        name: &str,
        parts: &Parts,
        gap: f32,
        lift: f32,
        free: bool,
    ) -> Option<super::kit::Place> {
        let (lo, hi) = bounds(parts);
        for _ in 0..12 {
            let turn = kit.rng.pick(&[0.0, 90.0, 180.0, 270.0]);
            let (w, d) = (hi.x - lo.x, hi.z.max(0.1));
            let (span, depth) = if turn % 180.0 == 0.0 {
                ((self.min.x, self.max.x), (self.min.z, self.max.z))
            } else {
                ((self.min.z, self.max.z), (self.min.x, self.max.x))
            };
            if span.1 - span.0 < w + 0.05 || depth.1 - depth.0 < d + 0.6 {
                continue;
            }
            // Some stand in corners.
            let s = match kit.rng.int(0, 5) {
                0 => span.0 + w / 2.0 + gap,
                1 => span.1 - w / 2.0 - gap,
                _ => kit.rng.range(span.0 + w / 2.0, span.1 - w / 2.0),
            };
            let back = if free {
                kit.rng.range(0.3, depth.1 - depth.0 - d)
            } else {
                gap
            };
            let forwards = turn == 0.0 || turn == 90.0;
            let e = if forwards {
                depth.0 + back
            } else {
                depth.1 - back
            };
            let far = if forwards { e + d } else { e - d };
            let across = (s - w / 2.0, s + w / 2.0);
            let depth = (e.min(far), e.max(far));
            let (x, z) = if turn % 180.0 == 0.0 {
                (across, depth)
            } else {
                (depth, across)
            };
            let taken = [x.0, x.1, z.0, z.1];
            if self.overlaps(taken) {
                continue;
            }
            self.taken.push(taken);
            let middle = if turn % 180.0 == 0.0 {
                Vec3::new(s, self.min.y + lift, e)
            } else {
                Vec3::new(e, self.min.y + lift, s)
            };
            // Asymmetrical parts keep their centre.
            let shift = -(hi.x + lo.x) / 2.0;
            let (sin, cos) = super::random::sin_cos(turn);
            let to = place(middle + Vec3::new(cos * shift, 0.0, -sin * shift), turn);
            kit.item(name, parts, to);
            return Some(to);
        }
        None
    }

    /// A lamp that makes the room's brightness about `target`: a panel at, in or below the ceiling,
    /// or a point light.
    pub fn light(&self, kit: &mut Kit, name: &str, target: f32) {
        let middle = (self.min + self.max) / 2.0;
        let d = self.max - self.min;
        let tint = [1.0, kit.rng.range(0.75, 1.0), kit.rng.range(0.55, 1.0)];
        if kit.rng.chance(0.25) {
            let cd = target * self.surface() / 5.0;
            let drop = kit.rng.range(0.3, 0.8);
            let at = middle.with_y(self.max.y - drop);
            kit.add_lamp(name, at, -Vec3::Y, Light::Point(tint.map(|c| c * cd)));
            return;
        }
        let n = if d.x > 5.0 || d.z > 5.0 { 2 } else { 1 };
        let (w, l) = (kit.rng.metres(0.2, 0.8), kit.rng.metres(0.4, 1.4));
        let radiance = target * self.surface() / (w * l * n as f32) * 0.5;
        let glow = kit.glow(name, tint.map(|c| (c * radiance * 10.0).round() / 10.0));
        let kind = kit.rng.int(0, 3);
        for i in 0..n {
            let along = (i as f32 + 0.5) / n as f32 - 0.5;
            let at = if d.x > d.z {
                middle + Vec3::X * d.x * along
            } else {
                middle + Vec3::Z * d.z * along
            };
            let y = self.max.y;
            let (x0, x1, z0, z1) = (
                at.x - w / 2.0,
                at.x + w / 2.0,
                at.z - l / 2.0,
                at.z + l / 2.0,
            );
            let g = match kind {
                // Flush under the ceiling, hanging, half in it; or a plane a millimetre below.
                0 => block([x0, y - 0.05, z0], [x1, y, z1]),
                1 => block([x0, y - 0.4, z0], [x1, y - 0.36, z1]),
                2 => block([x0, y - 0.02, z0], [x1, y + 0.02, z1]),
                _ => {
                    let p = |x: f32, z: f32| Vec3::new(x, y - 0.001, z);
                    quad([p(x0, z0), p(x1, z0), p(x1, z1), p(x0, z1)])
                }
            };
            kit.part(&format!("{name}_{i}"), &g, glow);
        }
    }

    /// Puts up to `n` pieces of furniture; `sink` draws how far each is above the floor.
    pub fn furnish(&mut self, kit: &mut Kit, p: &Palette, n: u32, gaps: &[f32], lifts: &[f32]) {
        for k in 0..n {
            let rng = &mut kit.rng;
            type Make = fn(&mut super::random::Random, &Palette) -> Parts;
            let (what, make): (&str, Make) = rng.pick(&[
                ("table", shapes::table as Make),
                ("chair", shapes::chair),
                ("sofa", shapes::sofa),
                ("shelf", shapes::shelf),
                ("cupboard", shapes::cupboard),
            ]);
            let parts = make(rng, p);
            let (gap, lift) = (rng.pick(gaps), rng.pick(lifts));
            let free = matches!(what, "table" | "chair") && rng.chance(0.7);
            self.stand(kit, &format!("{what}_{k}"), &parts, gap, lift, free);
        }
    }
}

/// A frame with a bar or two, and a sill, for a window.
pub(super) fn window_frame(kit: &mut Kit, o: &Opening, paint: usize, name: &str) {
    let f = kit.rng.metres(0.03, 0.08);
    let depth = kit.rng.pick(&[0.02, 0.05, 0.07]);
    let (w, h) = (o.width / 2.0, o.height);
    let z = kit.rng.range(-0.4, 0.4) * (o.thickness - depth).max(0.0);
    let bar = |x0: f32, x1: f32, y0: f32, y1: f32| {
        (
            block([x0, y0, z - depth / 2.0], [x1, y1, z + depth / 2.0]),
            paint,
        )
    };
    // Frames sit in the hole, or stand into the wall.
    let e = kit.rng.pick(&[0.0, 0.01, -0.001]);
    let mut parts = vec![
        bar(-w - e, -w + f, -e, h + e),
        bar(w - f, w + e, -e, h + e),
        bar(-w + f, w - f, -e, f),
        bar(-w + f, w - f, h - f, h + e),
    ];
    for i in 1..kit.rng.int(1, 3) {
        let x = -w + 2.0 * w * i as f32 / 2.0;
        parts.push(bar(x - f / 2.0, x + f / 2.0, f, h - f));
    }
    if kit.rng.chance(0.6) {
        let t = o.thickness / 2.0;
        parts.push((
            block([-w - 0.05, -0.03, -t], [w + 0.05, 0.0, t + 0.12]),
            paint,
        ));
    }
    kit.item(name, &parts, o.place());
}

/// A door's leaf, ajar by `degrees`, hung at the hole's left side; and a frame.
pub(super) fn door_leaf(kit: &mut Kit, o: &Opening, paint: usize, degrees: f32, name: &str) {
    let (w, h) = (o.width, o.height);
    let t = o.thickness / 2.0;
    let leaf = block([0.0, 0.008, -0.02], [w - 0.06, h - 0.035, 0.02]);
    let leaf = leaf.transformed(shapes::turned(
        -degrees,
        Vec3::new(-w / 2.0 + 0.03, 0.0, t + 0.02),
    ));
    let bar = |min: [f32; 3], max: [f32; 3]| (block(min, max), paint);
    let parts = vec![
        (leaf, paint),
        bar([-w / 2.0, 0.0, -t - 0.01], [-w / 2.0 + 0.03, h, t + 0.01]),
        bar([w / 2.0 - 0.03, 0.0, -t - 0.01], [w / 2.0, h, t + 0.01]),
        bar([-w / 2.0, h - 0.03, -t - 0.01], [w / 2.0, h, t + 0.01]),
    ];
    kit.item(name, &parts, o.place());
}

/// A colour for a sky: bluish, greyish or white.
pub(super) fn draw_sky(kit: &mut Kit) -> [f32; 3] {
    let level = kit.rng.range(1.0, 4.0);
    let blue = kit.rng.range(0.0, 0.4);
    [
        level * (1.0 - blue),
        level * (1.0 - blue * 0.5),
        level * (1.0 + blue * 0.3),
    ]
}

/// A sun from a direction between `from` and `to` degrees of azimuth (0 shines along +z, 90 along
/// +x).
pub(super) fn draw_sun(kit: &mut Kit, azimuth: [f32; 2], height: [f32; 2]) {
    let rng = &mut kit.rng;
    let (s, c) = super::random::sin_cos(rng.range(azimuth[0], azimuth[1]));
    let (up, level) = super::random::sin_cos(rng.range(height[0], height[1]));
    let lux = rng.range(4.0, 15.0);
    let warm = rng.range(0.6, 1.0);
    let angle = rng.pick(&[0.0, 0.53, 0.53, 0.53, 2.0, 5.0]);
    kit.add_sun(
        Vec3::new(s * level, -up, c * level),
        [lux, lux * (0.5 + warm / 2.0), lux * warm],
        angle,
    );
}
