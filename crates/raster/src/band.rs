//! A strip of image rows: what its pixels show.

use std::ops::Range;

/// Pixels a side of the tiles by which depths are summed up.
pub(crate) const TILE: usize = 8;

/// Pixels of a row that are drawn together.
pub(crate) const COLUMNS: usize = 8;

/// What a pixel shows, so that the greater key is seen: the bits of 1/z, which order like the numbers, above those of the
/// face, inverted so that the lower face wins where depths are equal. Background is 0: 1/z = 0 and [`NO_FACE`].
#[inline(always)]
pub(crate) fn key(w: f32, face: u32) -> i64 {
    i64::from(w.to_bits()) << 32 | i64::from(!face)
}

/// 1/z and face of a key.
#[inline(always)]
pub(crate) fn unlock(key: i64) -> (f32, u32) {
    (f32::from_bits((key >> 32) as u32), !(key as u32))
}

/// Rows `top..top + height` of the picture.
pub(crate) struct Band<'a> {
    pub(crate) top: i32,
    pub(crate) width: i32,
    pub(crate) height: i32,
    /// Keys in a row.
    pub(crate) stride: i32,
    /// One row more than the picture has of it, and more columns: triangles are drawn in blocks, whose ends may lie beyond.
    pub(crate) keys: &'a mut [i64],
    /// Which columns of each row of tiles may show anything; elsewhere the keys mean nothing.
    pub(crate) spans: &'a mut Vec<Range<usize>>,
}

impl Band<'_> {
    /// Begins with background; negative tiles, row by row, are not going to be drawn into.
    #[inline(always)]
    pub(crate) fn clear(&mut self, tiles: &[f32], tile_stride: usize) {
        let (width, stride) = (self.width as usize, self.stride as usize);
        self.spans.clear();
        for (tiles, rows) in tiles.chunks(tile_stride).zip(self.keys.chunks_mut(stride * TILE)) {
            let first = tiles.iter().position(|&tile| tile >= 0.0).unwrap_or_default();
            let end = tiles.iter().rposition(|&tile| tile >= 0.0).map_or(0, |last| last + 1);
            let span = first * TILE..(end * TILE).min(width);
            for row in rows.chunks_exact_mut(stride) {
                row[span.clone()].fill(0);
                row[width..].fill(i64::MAX);
            }
            self.spans.push(span);
        }
    }

    /// Shows a triangle at a pixel, by its index in the band, unless something nearer is there.
    #[inline(always)]
    pub(crate) fn put(&mut self, pixel: usize, w: f32, face: u32) {
        if let Some(there) = self.keys.get_mut(pixel) {
            *there = (*there).max(key(w, face));
        }
    }

    /// 1/z of the farthest pixel in each tile that may show anything, row by row of tiles; 0 where there is background.
    #[inline(always)]
    pub(crate) fn farthest(&self, tiles: &mut [f32], tile_stride: usize) {
        let stride = self.stride as usize;
        let rows = tiles.chunks_mut(tile_stride).zip(self.keys[..stride * self.height as usize].chunks(stride * TILE));
        for ((tiles, rows), span) in rows.zip(self.spans.iter()) {
            let tiles = &mut tiles[span.start / TILE..span.end.div_ceil(TILE)];
            for (tile, x) in tiles.iter_mut().zip(span.clone().step_by(TILE)) {
                let mut least = [i64::MAX; TILE];
                for keys in rows.chunks_exact(stride).filter_map(|row| row[x..].first_chunk::<TILE>()) {
                    for (least, &key) in least.iter_mut().zip(keys) {
                        *least = (*least).min(key);
                    }
                }
                *tile = unlock(least.into_iter().fold(i64::MAX, i64::min)).0;
            }
        }
    }
}
