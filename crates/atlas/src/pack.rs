//! Packs rectangles into pages.

use guillotiere::{AllocatorOptions, SimpleAtlasAllocator, size2};

/// Number of rectangles from which they are packed in rows. Guillotine packing searches its free
/// list for every rectangle, which takes quadratic time (10 ms for 6000). For thousands of
/// rectangles, rows of decreasing height fill the page equally well (both 97 %).
const ROWS_FROM: usize = 8000;

/// Rectangles packed on one or more pages.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PackedPages {
    /// Page and top left corner of each rectangle, in the order given.
    pub places: Vec<(u32, [u32; 2])>,
    /// Width and height of each page: multiples of the block, except for a single rectangle, whose
    /// page has exactly its size.
    pub pages: Vec<[u32; 2]>,
}

/// Packs `sizes` (width, height ≥ 1) without rotation into pages of at most `max_page` ×
/// `max_page`. Rectangles start at multiples of `block` texels (0 or 1: anywhere) and share no
/// block.
///
/// If one page is enough, it is nearly square and as tight as the search finds; otherwise there are
/// full pages and a tight last one. Deterministic. `None` if a rectangle exceeds the page.
///
/// ```
/// let packed = atlas::pack_pages(&[[6, 4], [2, 4]], 64, 4).expect("both fit");
/// assert_eq!(packed.pages.len(), 1);
/// // Each rectangle starts on a block of 4 × 4 texels.
/// assert!(packed.places.iter().all(|(_, at)| at[0] % 4 == 0 && at[1] % 4 == 0));
/// ```
pub fn pack_pages(sizes: &[[u32; 2]], max_page: u32, block: u32) -> Option<PackedPages> {
    if sizes.iter().flatten().any(|&s| s > max_page) {
        return None;
    }
    match sizes {
        [] => return Some(PackedPages::default()),
        [only] => {
            return Some(PackedPages {
                places: vec![(0, [0, 0])],
                pages: vec![*only],
            });
        }
        _ => {}
    }
    // Computed in whole blocks, unless a rectangle only fits without blocks because the page limit
    // is not a multiple of them.
    let block = block.max(1);
    let blocks: Vec<[u32; 2]> = sizes.iter().map(|s| s.map(|x| x.div_ceil(block))).collect();
    if blocks.iter().flatten().any(|&s| s > max_page / block) {
        return Some(in_units(sizes, max_page));
    }
    let mut packed = in_units(&blocks, max_page / block);
    for corner in packed.places.iter_mut().flat_map(|p| &mut p.1) {
        *corner *= block;
    }
    for side in packed.pages.iter_mut().flatten() {
        *side *= block;
    }
    Some(packed)
}

/// [`pack_pages`] for rectangles that all fit the page.
fn in_units(sizes: &[[u32; 2]], max_page: u32) -> PackedPages {
    let order = by_height(sizes);
    let mut result = PackedPages {
        places: vec![(0, [0, 0]); sizes.len()],
        pages: Vec::new(),
    };
    let mut rest = order;
    while !rest.is_empty() {
        let page = result.pages.len() as u32;
        if let Some((size, corners)) = tight_page(sizes, &rest, max_page) {
            for (&i, corner) in rest.iter().zip(corners) {
                result.places[i] = (page, corner);
            }
            result.pages.push(size);
            break;
        }
        let full = [max_page, max_page];
        let mut left = Vec::new();
        for (&i, corner) in rest.iter().zip(fill(sizes, &rest, full, false)) {
            match corner {
                Some(corner) => result.places[i] = (page, corner),
                None => left.push(i),
            }
        }
        result.pages.push(full);
        rest = left;
    }
    result
}

/// Indices of `sizes`, tallest first, then widest, then in the given order.
fn by_height(sizes: &[[u32; 2]]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse((sizes[i][1], sizes[i][0])), i));
    order
}

/// The smallest page found for all of `order`, and their corners in that order.
fn tight_page(
    sizes: &[[u32; 2]],
    order: &[usize],
    max_page: u32,
) -> Option<([u32; 2], Vec<[u32; 2]>)> {
    /// Widths relative to the square of equal area. Slightly wide or tall pages may fit better;
    /// beyond 4 : 3 a page is no longer roughly square.
    const WIDTHS: [f64; 5] = [1.0, 0.93, 1.07, 0.87, 1.15];
    let area: f64 = order
        .iter()
        .map(|&i| f64::from(sizes[i][0]) * f64::from(sizes[i][1]))
        .sum();
    if area > f64::from(max_page).powi(2) {
        return None;
    }
    let largest = |axis: usize| order.iter().map(|&i| sizes[i][axis]).max().unwrap_or(1);
    let round = |x: u32| x.min(max_page);
    let (widest, tallest) = (largest(0), largest(1));
    // Grow the page by 1.5 % per side until everything fits.
    let mut side = area.sqrt();
    loop {
        let mut best: Option<([u32; 2], Vec<[u32; 2]>)> = None;
        let mut all_full = true;
        for factor in WIDTHS {
            let width = round(widest.max((side * factor).ceil() as u32));
            let height = round(tallest.max((side * side / f64::from(width)).ceil() as u32));
            all_full &= width == max_page && height == max_page;
            let page = [width, height];
            let better = best
                .as_ref()
                .is_none_or(|(b, _)| page_area(page) < page_area(*b));
            if better {
                let placed = fill(sizes, order, page, true);
                let corners: Option<Vec<_>> = placed.into_iter().collect();
                if let Some(corners) = corners.filter(|c| c.len() == order.len()) {
                    best = Some((page, corners));
                }
            }
        }
        if best.is_some() {
            return best;
        }
        if all_full {
            return None;
        }
        side = grown(side);
    }
}

/// The side to try next: 1.5 % longer, so that the number of attempts grows with the logarithm of
/// the longest page.
fn grown(side: f64) -> f64 {
    (side * 1.015).max(side + 1.0)
}

fn page_area(page: [u32; 2]) -> u64 {
    u64::from(page[0]) * u64::from(page[1])
}

/// Places what fits of `order` on one page. With `all`, stops at the first rectangle that does not
/// fit and returns a shorter list.
fn fill(sizes: &[[u32; 2]], order: &[usize], page: [u32; 2], all: bool) -> Vec<Option<[u32; 2]>> {
    #[cfg(test)]
    tests::FILLS.set(tests::FILLS.get() + 1);
    if order.len() >= ROWS_FROM {
        return rows(sizes, order, page);
    }
    let options = AllocatorOptions {
        small_size_threshold: 8,
        large_size_threshold: 64,
        ..AllocatorOptions::default()
    };
    let mut allocator =
        SimpleAtlasAllocator::with_options(size2(page[0] as i32, page[1] as i32), &options);
    let mut placed = Vec::with_capacity(order.len());
    for &i in order {
        let place = allocator
            .allocate(size2(sizes[i][0] as i32, sizes[i][1] as i32))
            .map(|r| [r.min.x as u32, r.min.y as u32]);
        if all && place.is_none() {
            break;
        }
        placed.push(place);
    }
    placed
}

/// Rows of decreasing height: each rectangle goes to the end of the current row, or starts the
/// next.
fn rows(sizes: &[[u32; 2]], order: &[usize], page: [u32; 2]) -> Vec<Option<[u32; 2]>> {
    let (mut x, mut y, mut height) = (0u32, 0u32, 0u32);
    order
        .iter()
        .map(|&i| {
            let [w, h] = sizes[i];
            if w > page[0] || h > page[1] {
                return None;
            }
            if x + w > page[0] {
                // Saturates because, once a page is full, all later (lower) rectangles are tested
                // against this row.
                y = y.saturating_add(height);
                (x, height) = (0, 0);
            }
            if y.saturating_add(h) > page[1] {
                return None;
            }
            height = height.max(h);
            let corner = [x, y];
            x += w;
            Some(corner)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::{grown, pack_pages};

    thread_local! {
        /// Calls of `fill`: a page and all rectangles each.
        pub static FILLS: Cell<usize> = const { Cell::new(0) };
    }

    /// Attempts with a side that grows up to a page of `most` texels.
    fn attempts(from: f64, most: f64) -> usize {
        // Widths are down to 0.87 sides.
        let sides = std::iter::successors(Some(from), |side| Some(grown(*side)));
        5 * (1 + sides.take_while(|side| 0.87 * side < most).count())
    }

    #[test]
    fn attempts_grow_with_the_logarithm_of_a_page() {
        assert!(attempts(1.0, 16384.0) < 2600, "{}", attempts(1.0, 16384.0));
        // Two of them have less than a page's area, but do not fit it: every size is tried in vain.
        FILLS.set(0);
        let packed = pack_pages(&[[40, 40]; 2], 64, 1).expect("they fit pages");
        assert_eq!(packed.pages.len(), 2);
        let most = attempts(f64::hypot(40.0, 40.0), 64.0);
        let done = FILLS.get();
        // And a page each.
        assert!((10..=most + 2).contains(&done), "{done} of {most}");

        // A thousand: the sizes are tried once only, where the rest has less than a page's area.
        FILLS.set(0);
        let packed = pack_pages(&[[40, 40]; 1000], 64, 1).expect("they fit pages");
        assert_eq!(packed.pages.len(), 1000);
        assert!(FILLS.get() <= 1000 + most + 5, "{}", FILLS.get());
    }
}
