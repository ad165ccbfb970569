//! The size of the board that pictures show, when it is not the one that was asked for.

use crate::{Board, Sighting};

/// The size, columns and rows, of the board in the pictures, if they say clearly that it is another than `board`: no
/// picture shows the whole of `board` and nothing beyond, and most that show a grid at all show the same one without a
/// gap, whichever way it is turned.
pub fn other_size(sightings: &[Option<Sighting>], board: &Board) -> Option<(usize, usize)> {
    let seen: Vec<&Sighting> = sightings.iter().flatten().collect();
    if seen.iter().any(|sighting| sighting.is_whole(board)) {
        return None;
    }
    let upright =
        |(a, b): (usize, usize)| if board.columns >= board.rows { (a.max(b), a.min(b)) } else { (a.min(b), a.max(b)) };
    let full: Vec<(usize, usize)> = seen.iter().filter(|s| s.is_full).map(|s| upright(s.grid)).collect();
    let count = |size: &(usize, usize)| full.iter().filter(|other| *other == size).count();
    let commonest = *full.iter().max_by_key(|size| (count(size), size.0 * size.1))?;
    (2 * count(&commonest) > seen.len() && !board.is_like(commonest)).then_some(commonest)
}
