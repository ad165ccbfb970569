//! Rectangles into a strip of given width: the skyline bottom-left rule (J. Jylänki, *A thousand ways to pack the bin*, 2010),
//! tallest first.
//!
//! Crates for this hold at most 65,536 rectangles or try every place; a scan may have more charts than that.

/// Places rectangles `[width, height]`; returns their corners `[x, y]` of least coordinates and the height that is used, or `None`
/// if one is wider than the strip.
pub(crate) fn pack(sizes: &[[u32; 2]], width: u32) -> Option<(Vec<[u32; 2]>, u32)> {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(sizes[i][1]), std::cmp::Reverse(sizes[i][0]), i));
    let mut corners = vec![[0, 0]; sizes.len()];
    // The skyline: pieces `(x, y)` from left to right, each up to the x of the next.
    let mut skyline = vec![(0, 0)];
    let mut top = 0;
    for i in order {
        let [w, h] = sizes[i];
        let end = |skyline: &[(u32, u32)], k: usize| skyline.get(k + 1).map_or(width, |next| next.0);
        let mut best: Option<(u32, usize)> = None;
        for k in 0..skyline.len() {
            let x = skyline[k].0;
            if x + w > width {
                break;
            }
            let (mut y, mut j) = (0, k);
            while j < skyline.len() && skyline[j].0 < x + w && best.is_none_or(|(least, _)| y < least) {
                y = y.max(skyline[j].1);
                j += 1;
            }
            if best.is_none_or(|(least, _)| y < least) {
                best = Some((y, k));
            }
        }
        let (y, k) = best?;
        let x = skyline[k].0;
        corners[i] = [x, y];
        top = top.max(y + h);
        let mut last = k;
        while last + 1 < skyline.len() && skyline[last + 1].0 < x + w {
            last += 1;
        }
        let rest = (x + w < end(&skyline, last)).then_some((x + w, skyline[last].1));
        skyline.splice(k..=last, std::iter::once((x, y + h)).chain(rest));
    }
    Some((corners, top))
}

#[cfg(test)]
mod tests {
    use super::pack;

    #[test]
    fn rectangles_do_not_overlap_and_fill_the_strip() {
        // Sizes as a fixed recurrence makes them.
        let mut state = 1u32;
        let mut next = |n: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 16) % n + 1
        };
        let sizes: Vec<[u32; 2]> = (0..500).map(|_| [next(40), next(30)]).collect();
        let (corners, height) = pack(&sizes, 400).unwrap();
        let mut cells = vec![0u8; 400 * height as usize];
        for ([x, y], [w, h]) in corners.iter().zip(&sizes) {
            for cell in (*y..y + h).flat_map(|row| (*x..x + w).map(move |column| (row * 400 + column) as usize)) {
                cells[cell] += 1;
            }
        }
        assert!(cells.iter().all(|&count| count <= 1));
        let filled = cells.iter().filter(|&&count| count == 1).count();
        assert!(filled * 100 > cells.len() * 85, "{filled} of {}", cells.len());
        assert!(pack(&[[5, 1]], 4).is_none());
        assert_eq!(pack(&[], 4), Some((vec![], 0)));
    }
}
