//! Detects nodes that look like unmarked levels of detail of the same object.

use glam::Vec3;
use mesh_ingest::{Scene, Soup, level_by_name};
use visibility::{BuildOptions, Bvh, closest_point};

/// Lowest ratio of two extents along an axis that counts as alike. A ball of 20 triangles is 15 %
/// smaller than a finely tessellated one, and exporters shrink or grow levels a little.
const ALIKE: f32 = 0.75;

/// Largest distance between centres of bounds along an axis, as a fraction of the extent.
const CONCENTRIC: f32 = 0.1;

/// Objects thinner than this fraction of their size are panels. Coincident and crossing panels are
/// reported elsewhere.
const THIN: f32 = 0.05;

/// Largest ratio of the surface areas of two levels. A frame and its contents differ by more.
const AREAS: f64 = 2.0;

/// Largest distance between the surfaces of two levels, as a fraction of the diagonal.
const MAX_DISTANCE: f32 = 0.08;

/// Number of sample points on a surface, and how many of them may be away from the other surface.
const LOOKED_AT: usize = 32;
const ELSEWHERE: usize = 4;

/// Instances that look like levels of the same object, ascending.
pub(crate) type Likeness = Vec<usize>;

/// An instance that rays can hit.
struct Thing {
    instance: usize,
    low: Vec3,
    high: Vec3,
    area: f64,
}

impl Thing {
    fn size(&self) -> Vec3 {
        self.high - self.low
    }
}

/// Groups of such instances. If `named`, node names mark levels, so nodes with such names are left
/// out. If not, the user has turned names off, so these are left out too.
pub(crate) fn unmarked_levels(scene: &Scene, soup: &Soup, named: bool) -> Vec<Likeness> {
    let mut things = things(scene, soup, named);
    things.sort_by(|a, b| a.low.x.total_cmp(&b.low.x));
    let mut found: Vec<Likeness> = Vec::new();
    for (k, a) in things.iter().enumerate() {
        // Only bounds that begin within a fraction of `a`'s extent can be like `a`.
        let last = a.low.x + a.size().x;
        let after = things[k + 1..].iter().take_while(|b| b.low.x <= last);
        for b in after.filter(|b| are_alike(a, b) && lie_along(soup, a, b)) {
            match found
                .iter_mut()
                .find(|g| g.contains(&a.instance) || g.contains(&b.instance))
            {
                Some(group) => {
                    for i in [a.instance, b.instance] {
                        if !group.contains(&i) {
                            group.push(i);
                        }
                    }
                }
                None => found.push(vec![a.instance, b.instance]),
            }
        }
    }
    for group in &mut found {
        group.sort_unstable();
    }
    found.sort();
    found
}

fn things(scene: &Scene, soup: &Soup, named: bool) -> Vec<Thing> {
    let told = |i: usize| !named && level_by_name(&scene.instances[i].name).is_some();
    (0..scene.instances.len())
        .filter(|&i| scene.has_lumels(i) && scene.instances[i].stands_in.is_none() && !told(i))
        .filter_map(|instance| {
            let [first, end] = soup.instance_ranges[instance].map(|t| t as usize);
            let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
            for p in soup.triangles[first..end].iter().flatten() {
                (low, high) = (low.min(*p), high.max(*p));
            }
            let thing = Thing {
                instance,
                low,
                high,
                area: soup.areas[first..end].iter().map(|a| f64::from(*a)).sum(),
            };
            let size = thing.size();
            (first < end && size.min_element() > THIN * size.max_element()).then_some(thing)
        })
        .collect()
}

fn are_alike(a: &Thing, b: &Thing) -> bool {
    let (sa, sb) = (a.size(), b.size());
    let larger = sa.max(sb);
    let apart = (0.5 * (a.low + a.high - b.low - b.high)).abs();
    sa.min(sb).cmpge(ALIKE * larger).all()
        && apart.cmple(CONCENTRIC * larger).all()
        && a.area.max(b.area) <= AREAS * a.area.min(b.area)
}

/// Whether each surface lies close to the other.
fn lie_along(soup: &Soup, a: &Thing, b: &Thing) -> bool {
    let reach = MAX_DISTANCE * a.size().max(b.size()).length();
    [(a, b), (b, a)].into_iter().all(|(a, b)| {
        let [first, end] = soup.instance_ranges[b.instance].map(|t| t as usize);
        let Ok(tree) = Bvh::build(
            &soup.triangles[first..end],
            |_| true,
            &BuildOptions::default(),
        ) else {
            return false;
        };
        let [first, end] = soup.instance_ranges[a.instance].map(|t| t as usize);
        let step = (end - first).div_ceil(LOOKED_AT).max(1);
        let middles = soup.triangles[first..end].iter().step_by(step);
        let far = middles.filter(|[a, b, c]| {
            let p = (*a + *b + *c) / 3.0;
            !tree.any_near(p - reach, p + reach, |_, corners| {
                closest_point(corners, p).0.distance(p) <= reach
            })
        });
        far.count() <= ELSEWHERE
    })
}
