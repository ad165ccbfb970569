//! How well views explain a small picture: for comparing views that are far from each other.
//!
//! A view is rendered, and the mutual information between what the pixels predict and the photo's colours is taken twice: over the
//! whole picture, where the photo's own density is the same for all views but the share of background differs; and over
//! the model and a band around it, where the share is the same but the photo's density differs. Each is misled where the other
//! is not. Bins are few and hard: no derivative is wanted.

use crate::Photo;
use crate::counts::Counts;
use crate::model::{surrounds, viewpoint};
use crate::outlines::{Outline, edges};
use crate::palette::palette;
use crate::samples::dither;
use std::sync::OnceLock;
use texreg_camera::View;
use texreg_raster::{GBuffer, NO_FACE, Options, Renderer, outline};
use texreg_surface::{Mesh, Signal, Surfel};

/// How far around the silhouette the background counts, in pixels of the picture.
const BAND: f32 = 5.0;

/// The background's share of samples, over the model's.
const SHARE: f32 = 0.5;

/// How much more a difference of hue counts than one of brightness.
const HUE: f32 = 2.0;

/// A small picture of the photo.
pub(crate) struct Overview {
    /// Pixels of the photo, along each axis, that make one of the picture.
    pub(crate) factor: usize,
    /// Pixels a row.
    pub(crate) width: usize,
    /// Rows.
    pub(crate) height: usize,
    /// The colour of each pixel.
    pub(crate) colours: Vec<u16>,
    /// How many pixels have each colour.
    pub(crate) palette: Vec<u32>,
    pixels: Vec<[f32; 3]>,
    edges: OnceLock<Vec<[f32; 3]>>,
    entropies: Counts,
}

/// The working memory of one thread.
#[derive(Default)]
pub(crate) struct Workspace {
    renderer: Renderer,
    picture: GBuffer,
    /// What each pixel predicts.
    bins: Vec<u16>,
    /// The pixels of each bin and colour, row by row; the background is the last row.
    counts: Vec<u32>,
}

/// How well a view explains the picture, in nats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Evidence {
    /// Over the whole picture.
    pub(crate) whole: f64,
    /// Over the model and a band around it.
    pub(crate) near: f64,
}

impl Evidence {
    /// Both, the whole picture counted twice: its values are smaller, as most of its pixels are background in any view.
    pub(crate) fn total(&self) -> f64 {
        2.0 * self.whole + self.near
    }
}

impl Overview {
    /// The photo reduced to at most `side` pixels on its longer side and to about `colours` colours.
    pub(crate) fn new(photo: &Photo, side: u32, colours: usize) -> Self {
        let factor = photo.width.max(photo.height).div_ceil(side) as usize;
        let (width, height) = (photo.width as usize / factor, photo.height as usize / factor);
        let mean = |x: usize, y: usize| {
            let rows = (y * factor..(y + 1) * factor).map(|row| &photo.rgb[row * photo.width as usize..]);
            let mut sum = [0.0f32; 3];
            for pixel in rows.flat_map(|row| &row[x * factor..(x + 1) * factor]) {
                sum.iter_mut().zip(pixel).for_each(|(sum, &value)| *sum += f32::from(value));
            }
            let [red, green, blue] = sum.map(|sum| sum / (factor * factor) as f32);
            let grey = (red + green + blue) / 3.0;
            [grey, HUE * (red - grey), HUE * (blue - grey)]
        };
        let pixels: Vec<[f32; 3]> = (0..width * height).map(|i| mean(i % width, i / width)).collect();
        let colours = palette(&pixels, colours);
        Self::of(factor, width, height, colours, pixels)
    }

    /// A picture of such pixels, row by row.
    pub(crate) fn of(factor: usize, width: usize, height: usize, colours: Vec<u16>, pixels: Vec<[f32; 3]>) -> Self {
        let mut palette = vec![0; colours.iter().max().map_or(0, |&most| usize::from(most) + 1)];
        colours.iter().for_each(|&colour| palette[usize::from(colour)] += 1);
        let entropies = Counts::up_to(width * height);
        Self { factor, width, height, colours, palette, pixels, edges: OnceLock::new(), entropies }
    }

    /// Its [edges], found when first needed.
    pub(crate) fn edges(&self) -> &[[f32; 3]] {
        self.edges.get_or_init(|| edges(self.width, self.height, &self.pixels))
    }

    /// How much better a view explains the whole picture than the same rendering in eight other places, half the model's
    /// size away: what smooth surfaces explain of smooth backgrounds by chance, they explain there as well. To lie on edges counts
    /// for an outline as long as the picture's border as much as `edges` nats. `None` where the view shows nothing of the model.
    pub(crate) fn peak(
        &self,
        mesh: &Mesh,
        signal: &dyn Signal,
        edges: f64,
        workspace: &mut Workspace,
        view: &View,
    ) -> Option<f64> {
        let (whole, covered) = self.whole(mesh, signal, workspace, view)?;
        if covered == 0 && !surrounds(mesh, view) {
            return None;
        }
        let outline = if edges > 0.0 { Outline::of(&workspace.picture) } else { Outline::default() };
        let weight = edges * self.weight(&outline);
        let on = |dx: isize, dy: isize| {
            weight
                * outline.on(|x, y| {
                    let (x, y) = (usize::try_from(x + dx).ok()?, usize::try_from(y + dy).ok()?);
                    (x < self.width && y < self.height).then(|| &self.edges()[y * self.width + x])
                })
        };
        let away = (0.5 * f64::from(covered).sqrt()).ceil() as isize;
        let mut chance = 0.0;
        for (dx, dy) in [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)] {
            let (dx, dy) = (dx * away, dy * away);
            self.count(workspace, signal.bins(), (dx, dy));
            chance += 0.125 * (self.information(&workspace.counts, &self.palette)? + on(dx, dy));
        }
        Some(whole + on(0, 0) - chance)
    }

    /// What it counts that an outline lies on edges, by its length: errors of a mean fall with the root of a number.
    pub(crate) fn weight(&self, outline: &Outline) -> f64 {
        (outline.pixels.len() as f64 / (2 * (self.width + self.height)) as f64).sqrt()
    }

    /// The evidence for a view; `None` where it shows nothing of the model.
    pub(crate) fn evidence(
        &self,
        mesh: &Mesh,
        signal: &dyn Signal,
        workspace: &mut Workspace,
        view: &View,
    ) -> Option<Evidence> {
        let (whole, covered) = self.whole(mesh, signal, workspace, view)?;
        if surrounds(mesh, view) {
            // A scan from inside ends where the scanner saw no farther: what is beside it is no background.
            return Some(Evidence { whole, near: 0.0 });
        }
        if covered == 0 {
            return None;
        }
        let (picture, counts) = (&workspace.picture, &mut workspace.counts);
        let halo = outline(picture, BAND);
        let share = SHARE * covered as f32 / halo.len() as f32;
        let (model, background) = counts.split_at_mut(signal.bins() * self.palette.len());
        background.fill(0);
        for pixel in halo {
            let i = pixel.pixel as usize;
            if dither(i % self.width, i / self.width) < share {
                background[usize::from(self.colours[i])] += 1;
            }
        }
        let mut columns = background.to_vec();
        for row in model.chunks_exact(columns.len()) {
            columns.iter_mut().zip(row).for_each(|(sum, n)| *sum += n);
        }
        Some(Evidence { whole, near: self.information(counts, &columns)? })
    }

    /// Renders a view, and counts: the mutual information over the whole picture, and the pixels that show the model.
    fn whole(&self, mesh: &Mesh, signal: &dyn Signal, workspace: &mut Workspace, view: &View) -> Option<(f64, u32)> {
        let Workspace { renderer, picture, bins, .. } = workspace;
        let mut camera = view.camera.scaled(1.0 / self.factor as f64);
        (camera.width, camera.height) = (self.width as u32, self.height as u32);
        let options = Options { parallel: false, ..Options::default() };
        renderer.render(&mesh.shape(), &camera, &view.pose, &options, picture);
        let viewpoint = viewpoint(view);
        let background = signal.bins() as u16;
        bins.clear();
        bins.extend(picture.face.iter().map(|&face| {
            if face == NO_FACE {
                return background;
            }
            let corners = mesh.triangles[face as usize];
            let surfel = Surfel { mesh, corners, weights: [1.0 / 3.0; 3], viewpoint: &viewpoint };
            signal.bin(&surfel) as u16
        }));
        self.count(workspace, signal.bins(), (0, 0));
        let model = &workspace.counts[..signal.bins() * self.palette.len()];
        Some((self.information(&workspace.counts, &self.palette)?, model.iter().sum()))
    }

    /// Counts the colours of each bin with the rendering shifted by so many pixels.
    fn count(&self, workspace: &mut Workspace, bins: usize, (dx, dy): (isize, isize)) {
        let Workspace { bins: rendered, counts, .. } = workspace;
        let colours = self.palette.len();
        counts.clear();
        counts.resize(bins * colours, 0);
        counts.extend(&self.palette);
        let background = bins * colours;
        let (width, height) = (self.width as isize, self.height as isize);
        let columns = (-dx).clamp(0, width)..(width - dx).clamp(0, width);
        for y in (-dy).clamp(0, height)..(height - dy).clamp(0, height) {
            let from = &rendered[(y * width) as usize..][columns.start as usize..columns.end as usize];
            let onto = &self.colours[((y + dy) * width + columns.start + dx) as usize..];
            for (&bin, &colour) in from.iter().zip(onto) {
                if usize::from(bin) != bins {
                    counts[usize::from(bin) * colours + usize::from(colour)] += 1;
                    counts[background + usize::from(colour)] -= 1;
                }
            }
        }
    }

    fn information(&self, counts: &[u32], columns: &[u32]) -> Option<f64> {
        self.entropies.information(counts.chunks_exact(columns.len()), columns)
    }
}
