//! The silhouettes: how little the model's outline leaves open about where the photo shows the object.
//!
//! With U whether a place of the photo is inside the model's silhouette, and V whether it shows the object (softly, `s(x)` from 0
//! to 1), the metric is `−H(V | U)` over all places. The table is made of areas, and areas are integrals along the outline
//! (Green's theorem): `p(1, 1) = 1/A ∮ F dy` with `∂F/∂x = s`, and `p(1, 1) + p(1, 0) = 1/A ∮ x dy`. So value and gradient are
//! exact sums over the outline's edges, whose corners move rigidly with the model; along a displacement `δ` the first is
//! `∮ s n·δ ds / A`, the classic contour integral.

use crate::Refine;
use crate::grid::Grid;
use crate::parameters::{Dense, MOST};
use crate::sweep::{Sums, chain};
use nalgebra::{Point2, Point3, Vector2};
use texreg_camera::{Camera, View};
use texreg_mi::{ConditionalEntropy, Joint, Metric};
use texreg_raster::{GBuffer, NO_FACE};

/// Where a level of the photo shows the object, integrated along its rows.
#[derive(Clone, Debug)]
pub(crate) struct Silhouette {
    /// `F` at half a pixel to the left: the sums along the rows.
    integral: Grid<f64>,
    /// The object's share of the picture.
    share: f64,
}

impl Silhouette {
    /// From how much of each pixel shows the object, 0 to 1.
    pub(crate) fn new(width: usize, height: usize, mask: &[f32]) -> Self {
        let mut sums = Vec::with_capacity(mask.len());
        for row in mask.chunks_exact(width) {
            sums.extend(row.iter().scan(0.0, |sum, &value| {
                *sum += f64::from(value);
                Some(*sum)
            }));
        }
        let total: f64 = mask.iter().map(|&value| f64::from(value)).sum();
        Self { integral: Grid::new(width, height, &sums), share: total / mask.len() as f64 }
    }

    /// `F` and its gradient.
    fn integral(&self, place: &Point2<f64>) -> [f64; 3] {
        let (width, height) = (self.integral.width as f64, self.integral.height as f64);
        let x = (place.x - 0.5).clamp(-0.5, width - 0.5);
        self.integral.sample(x, place.y.clamp(-0.5, height - 0.5)).unwrap_or_default()
    }

    fn area(&self) -> f64 {
        (self.integral.width * self.integral.height) as f64
    }
}

/// A corner of the outline.
#[derive(Clone, Copy, Debug)]
enum Corner {
    /// It moves with the model.
    Model(Point3<f64>),
    /// It is the picture that ends here.
    Picture(Point2<f64>),
}

/// The outline of a rendered model as closed loops of edges between pixels.
#[derive(Clone, Debug, Default)]
pub(crate) struct Contour {
    corners: Vec<Corner>,
    /// From one corner to another, the model on the side of smaller x where an edge leads down.
    edges: Vec<[u32; 2]>,
}

impl Contour {
    /// The outline of what a rendering shows, by corners of pixels put at the depth of the nearest covered pixel that touches them.
    pub(crate) fn of(picture: &GBuffer, camera: &Camera, view: &View) -> Self {
        let (width, height) = (picture.width as usize, picture.height as usize);
        let covered = |x: isize, y: isize| {
            let inside = x >= 0 && y >= 0 && x < width as isize && y < height as isize;
            inside && picture.face[y as usize * width + x as usize] != NO_FACE
        };
        let mesh_from_camera = view.pose.inverse();
        let place = |x: usize, y: usize| {
            let pixel = Point2::new(x as f64 - 0.5, y as f64 - 0.5);
            if x == 0 || y == 0 || x == width || y == height {
                return Corner::Picture(pixel);
            }
            let around = [(x - 1, y - 1), (x, y - 1), (x - 1, y), (x, y)].map(|(x, y)| y * width + x);
            let shown = around.into_iter().filter(|&i| picture.face[i] != NO_FACE);
            let depth = shown.map(|i| picture.depth[i]).fold(f32::INFINITY, f32::min);
            match camera.unproject(&pixel) {
                Some(ray) => Corner::Model(mesh_from_camera.transform_point(&Point3::from(ray * f64::from(depth)))),
                None => Corner::Picture(pixel),
            }
        };
        let mut contour = Self::default();
        let mut index = vec![u32::MAX; (width + 1) * (height + 1)];
        let mut corner = |x: usize, y: usize, corners: &mut Vec<Corner>| {
            let entry = &mut index[y * (width + 1) + x];
            if *entry == u32::MAX {
                *entry = corners.len() as u32;
                corners.push(place(x, y));
            }
            *entry
        };
        for y in 0..height {
            for x in 0..width {
                let (i, j) = (x as isize, y as isize);
                if !covered(i, j) {
                    continue;
                }
                let sides = [
                    (covered(i + 1, j), [(x + 1, y), (x + 1, y + 1)]),
                    (covered(i - 1, j), [(x, y + 1), (x, y)]),
                    (covered(i, j + 1), [(x + 1, y + 1), (x, y + 1)]),
                    (covered(i, j - 1), [(x, y), (x + 1, y)]),
                ];
                for (_, ends) in sides.into_iter().filter(|(neighbour, _)| !neighbour) {
                    let edge = ends.map(|(x, y)| corner(x, y, &mut contour.corners));
                    contour.edges.push(edge);
                }
            }
        }
        contour
    }

    /// Where the corners are seen, kept within the picture; NaN for one that is not.
    fn project(&self, silhouette: &Silhouette, camera: &Camera, view: &View) -> Vec<Point2<f64>> {
        let (right, bottom) = (silhouette.integral.width as f64 - 0.5, silhouette.integral.height as f64 - 0.5);
        let seen = |corner: &Corner| match corner {
            Corner::Model(point) => camera.project(&view.pose.transform_point(point)),
            Corner::Picture(pixel) => Some(*pixel),
        };
        let within = |p: Point2<f64>| Point2::new(p.x.clamp(-0.5, right), p.y.clamp(-0.5, bottom));
        self.corners.iter().map(|corner| seen(corner).map_or(Point2::new(f64::NAN, f64::NAN), within)).collect()
    }

    /// The table of places inside and outside of both silhouettes; `None` where the outline cannot be seen.
    fn table(silhouette: &Silhouette, pixels: &[Point2<f64>], edges: &[[u32; 2]]) -> Option<Joint> {
        let (mut both, mut model) = (0.0, 0.0);
        for &[a, b] in edges {
            let (a, b) = (pixels[a as usize], pixels[b as usize]);
            let middle = nalgebra::center(&a, &b);
            both += silhouette.integral(&middle)[0] * (b.y - a.y);
            model += middle.x * (b.y - a.y);
        }
        let area = silhouette.area();
        let (both, model, photo) = (both / area, model / area, silhouette.share);
        let cells = [1.0 - model - photo + both, photo - both, 0.0, model - both, both, 0.0];
        let cells: Vec<f64> = cells.into_iter().map(|p: f64| if p.is_nan() { p } else { p.max(0.0) }).collect();
        cells.iter().all(|p| p.is_finite()).then(|| Joint::from_masses(2, cells))
    }

    /// `−H(V | U)` in nats, of places of the photo.
    pub(crate) fn value(&self, silhouette: &Silhouette, camera: &Camera, view: &View) -> Option<f64> {
        let pixels = self.project(silhouette, camera, view);
        Some(ConditionalEntropy.value(&Self::table(silhouette, &pixels, &self.edges)?))
    }

    /// What the value would be if places of the model and of the object had nothing to do with each other: `−H(V)`.
    pub(crate) fn independent(&self, silhouette: &Silhouette, camera: &Camera, view: &View) -> Option<f64> {
        let pixels = self.project(silhouette, camera, view);
        Some(ConditionalEntropy.value(&Self::table(silhouette, &pixels, &self.edges)?.independent()))
    }

    /// The derivatives of [`value`](Self::value) by the tangent; `scale` is that of the level.
    ///
    /// The curvature is that of a gap between the outlines, `gap` pixels wide on average, that closes: the metric falls by the
    /// width of the gap times the table's contrast, which is as steep as a parabola of curvature `contrast / gap`.
    pub(crate) fn derivatives(
        &self,
        silhouette: &Silhouette,
        camera: &Camera,
        view: &View,
        refine: Refine,
        scale: f64,
    ) -> Dense {
        let dimension = refine.dimension();
        let mut sums = Sums::<MOST>::default();
        let mut curvature = Sums::<MOST>::default();
        let pixels = self.project(silhouette, camera, view);
        let Some(joint) = Self::table(silhouette, &pixels, &self.edges) else {
            return sums.derivatives(dimension, 0.0);
        };
        let d = ConditionalEntropy.derivative(&joint);
        let area = silhouette.area();
        // More of the model's area, and more of it where the photo shows the object.
        let (by_model, by_both) = ((d[3] - d[0]) / area, (d[4] - d[1] - d[3] + d[0]) / area);
        let p = joint.cells();
        let gap = ((p[1] + p[3]) * area / self.edges.len().max(1) as f64).max(0.5);
        let stiffness = by_both.abs() / gap;
        let (right, bottom) = (silhouette.integral.width as f64 - 0.5, silhouette.integral.height as f64 - 0.5);
        for &[a, b] in &self.edges {
            let ends = [a, b].map(|i| pixels[i as usize]);
            let middle = nalgebra::center(&ends[0], &ends[1]);
            let [f, fx, fy] = silhouette.integral(&middle);
            let across = ends[1].y - ends[0].y;
            // The sum's derivatives by the middle and by the difference in y of the ends.
            let by_middle = 0.5 * across * Vector2::new(by_both * fx + by_model, by_both * fy);
            let by_rise = by_both * f + by_model * middle.x;
            let along = ends[1] - ends[0];
            let normal = 0.5 * Vector2::new(along.y, -along.x);
            let mut row = [0.0; MOST];
            let mut shift = [0.0; MOST];
            for (k, sign) in [(a, -1.0), (b, 1.0)] {
                let Corner::Model(point) = &self.corners[k as usize] else { continue };
                let pixel = pixels[k as usize];
                let free = |gradient: Vector2<f64>| {
                    let moves = [pixel.x > -0.5 && pixel.x < right, pixel.y > -0.5 && pixel.y < bottom];
                    Vector2::from_fn(|i, _| if moves[i] { gradient[i] } else { 0.0 })
                };
                let gradient = free(by_middle + Vector2::new(0.0, sign * by_rise));
                if let Some(part) = chain(view, camera, refine, scale, point, &gradient) {
                    row.iter_mut().zip(part).for_each(|(sum, x)| *sum += x);
                }
                if let Some(part) = chain(view, camera, refine, scale, point, &free(normal)) {
                    shift.iter_mut().zip(part).for_each(|(sum, x)| *sum += x);
                }
            }
            sums.add(&row[..dimension]);
            curvature.add(&shift[..dimension]);
        }
        let gradient = sums.derivatives(dimension, 1.0).gradient;
        Dense { gradient, curvature: curvature.derivatives(dimension, stiffness).curvature }
    }
}
