//! How well views explain a small picture: for comparing views that are far from each other.
//!
//! A view is rendered, and the mutual information between what the pixels predict and the photo's colours is taken twice: over the
//! whole picture, where the photo's own density is the same for all views but the share of background differs; and over
//! the model and a band around it, where the share is the same but the photo's density differs. Each is misled where the other
//! is not. Bins are few and hard: no derivative is wanted.

use crate::Photo;
use crate::model::{surrounds, viewpoint};
use crate::palette::palette;
use crate::samples::dither;
use texreg_camera::View;
use texreg_mi::{Joint, Metric, MutualInformation};
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
}

/// The working memory of one thread.
#[derive(Default)]
pub(crate) struct Workspace {
    renderer: Renderer,
    picture: GBuffer,
    bins: Vec<u16>,
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
    pub(crate) fn total(self) -> f64 {
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
        let mut palette = vec![0; colours.iter().max().map_or(0, |&most| usize::from(most) + 1)];
        colours.iter().for_each(|&colour| palette[usize::from(colour)] += 1);
        Self { factor, width, height, colours, palette }
    }

    /// How much better a view explains the whole picture than the same rendering in eight other places, half the model's
    /// size away: what smooth surfaces explain of smooth backgrounds by chance, they explain there as well. `None` where
    /// the view shows nothing of the model.
    pub(crate) fn peak(&self, mesh: &Mesh, signal: &dyn Signal, workspace: &mut Workspace, view: &View) -> Option<f64> {
        let evidence = self.evidence(mesh, signal, workspace, view)?;
        let background = signal.bins() as u16;
        let covered = workspace.bins.iter().filter(|&&bin| bin != background).count() as f64;
        let away = (0.5 * covered.sqrt()).ceil() as i32;
        let (width, height) = (self.width as i32, self.height as i32);
        let mut chance = 0.0;
        for (dx, dy) in [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)] {
            let mut counts = vec![0u32; (usize::from(background) + 1) * self.palette.len()];
            for (i, &colour) in self.colours.iter().enumerate() {
                let (x, y) = (i as i32 % width + dx * away, i as i32 / width + dy * away);
                let inside = (0..width).contains(&x) && (0..height).contains(&y);
                let bin = if inside { workspace.bins[(y * width + x) as usize] } else { background };
                counts[usize::from(bin) * self.palette.len() + usize::from(colour)] += 1;
            }
            chance += 0.125 * information(usize::from(background) + 1, &counts)?;
        }
        Some(evidence.whole - chance)
    }

    /// The evidence for a view; `None` where it shows nothing of the model.
    pub(crate) fn evidence(
        &self,
        mesh: &Mesh,
        signal: &dyn Signal,
        workspace: &mut Workspace,
        view: &View,
    ) -> Option<Evidence> {
        let Workspace { renderer, picture, bins } = workspace;
        let mut camera = view.camera.scaled(1.0 / self.factor as f64);
        (camera.width, camera.height) = (self.width as u32, self.height as u32);
        let triangles = mesh.shape();
        let options = Options { parallel: false, ..Options::default() };
        renderer.render(&triangles, &camera, &view.pose, &options, picture);
        let viewpoint = viewpoint(view);
        let background = signal.bins();
        bins.clear();
        bins.extend(picture.face.iter().map(|&face| {
            if face == NO_FACE {
                return background as u16;
            }
            let corners = mesh.triangles[face as usize];
            let surfel = Surfel { mesh, corners, weights: [1.0 / 3.0; 3], viewpoint: &viewpoint };
            signal.bin(&surfel) as u16
        }));
        let colours = self.palette.len();
        let mut counts = vec![0u32; (background + 1) * colours];
        for (&bin, &colour) in bins.iter().zip(&self.colours) {
            counts[usize::from(bin) * colours + usize::from(colour)] += 1;
        }
        let whole = information(background + 1, &counts)?;
        if surrounds(mesh, view) {
            // A scan from inside ends where the scanner saw no farther: what is beside it is no background.
            return Some(Evidence { whole, near: 0.0 });
        }
        let covered: u32 = counts[..background * colours].iter().sum();
        if covered == 0 {
            return None;
        }
        let halo = outline(picture, BAND);
        let share = SHARE * covered as f32 / halo.len() as f32;
        counts[background * colours..].fill(0);
        for pixel in halo {
            let i = pixel.pixel as usize;
            if dither(i % self.width, i / self.width) < share {
                counts[background * colours + usize::from(self.colours[i])] += 1;
            }
        }
        Some(Evidence { whole, near: information(background + 1, &counts)? })
    }
}

/// Mutual information from counts, less what chance alone would show: G. Miller, *Note on the bias of information estimates*,
/// in Information Theory in Psychology, 1955. `None` without a sample.
fn information(rows: usize, counts: &[u32]) -> Option<f64> {
    let total: u32 = counts.iter().sum();
    let joint = Joint::from_masses(rows, counts.iter().map(|&count| f64::from(count)).collect());
    let occupied = |density: &[f64]| density.iter().filter(|&&p| p > 0.0).count() as f64;
    let freedom = occupied(joint.cells()) - occupied(&joint.model_marginal()) - occupied(&joint.photo_marginal()) + 1.0;
    (total > 0).then(|| MutualInformation.value(&joint) - 0.5 * freedom / f64::from(total))
}
