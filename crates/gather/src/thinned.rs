//! A bounded part of a long sequence, for figures about all of it.

/// Most items that are kept. A median or root mean square over a million lumels does not depend on
/// which ones they are, and 64 million would take gigabytes.
const MOST: usize = 4 << 20;

/// Factor by which items are thinned. It is odd, so that rows of lumels, whose widths are even, are
/// not kept by columns.
const FACTOR: usize = 3;

/// Evenly spread items of a sequence: all of them up to [`MOST`], at least a third of that many
/// beyond.
pub(crate) struct Thinned<T> {
    items: Vec<T>,
    /// Every `stride`th item of the sequence is kept.
    stride: u64,
    /// Length of the sequence.
    length: u64,
    most: usize,
}

impl<T> Default for Thinned<T> {
    fn default() -> Self {
        Thinned::of(MOST)
    }
}

impl<T> Thinned<T> {
    fn of(most: usize) -> Self {
        Thinned {
            items: Vec::new(),
            stride: 1,
            length: 0,
            most,
        }
    }

    /// Adds the next item of the sequence.
    pub(crate) fn push(&mut self, item: T) {
        if self.length.is_multiple_of(self.stride) {
            self.items.push(item);
            if self.items.len() > self.most {
                let mut index = 0;
                self.items.retain(|_| {
                    index += 1;
                    (index - 1) % FACTOR == 0
                });
                self.items.shrink_to(self.most);
                self.stride *= FACTOR as u64;
            }
        }
        self.length += 1;
    }

    /// The items that are kept, in order.
    pub(crate) fn items(&self) -> &[T] {
        &self.items
    }
}

impl<T> Extend<T> for Thinned<T> {
    fn extend<I: IntoIterator<Item = T>>(&mut self, items: I) {
        items.into_iter().for_each(|item| self.push(item));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_items_are_all_kept_and_many_are_spread_evenly() {
        let kept = |n: u64| {
            let mut thinned = Thinned::of(100);
            thinned.extend(0..n);
            thinned.items().to_vec()
        };
        assert_eq!(kept(100), (0..100).collect::<Vec<_>>());
        for n in [101, 300, 301, 5_000, 100_000] {
            let kept = kept(n);
            assert!((34..=100).contains(&kept.len()), "{n}: {}", kept.len());
            let stride = kept[1];
            assert!(
                kept.iter()
                    .enumerate()
                    .all(|(i, &x)| x == i as u64 * stride)
            );
            assert!(n - kept[kept.len() - 1] <= stride);
        }
    }
}
