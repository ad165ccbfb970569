//! The rendered picture: what each pixel sees.

/// [`GBuffer::face`] of a pixel that sees no triangle.
pub const NO_FACE: u32 = u32::MAX;

/// A geometry buffer: depth and face of the surface point in each pixel's centre, row-major from the top left.
///
/// Pixel `(x, y)` is entry `y * width + x`, its centre at image coordinates `(x, y)` exactly.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GBuffer {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Camera z of the visible surface point in model units, `INFINITY` on background.
    pub depth: Vec<f32>,
    /// Index of the visible triangle, [`NO_FACE`] on background.
    pub face: Vec<u32>,
    /// Perspective-correct weights of the triangle's second and third corner (the first has the rest to 1), `[0, 0]` on
    /// background. Empty unless [`Options::barycentric`](crate::Options::barycentric) asked for it.
    pub barycentric: Vec<[f32; 2]>,
}

impl GBuffer {
    /// The number of pixels that see the surface.
    pub fn covered(&self) -> usize {
        self.face.iter().filter(|&&face| face != NO_FACE).count()
    }

    /// The silhouette mask: 255 where a pixel sees the surface, 0 elsewhere.
    pub fn silhouette(&self) -> Vec<u8> {
        self.face.iter().map(|&face| if face == NO_FACE { 0 } else { 255 }).collect()
    }

    /// Interpolates a vertex attribute of `N` numbers over the picture; background pixels get `background`.
    ///
    /// `indices` are the triangles that were rendered. Empty when the buffer has no barycentrics; a pixel whose attribute is
    /// missing counts as background.
    pub fn interpolate<const N: usize>(
        &self,
        indices: &[[u32; 3]],
        attribute: &[[f32; N]],
        background: [f32; N],
    ) -> Vec<[f32; N]> {
        let value = |face: u32, [v, w]: [f32; 2]| {
            let [a, b, c] = *indices.get(face as usize)?;
            let at = |i: u32| attribute.get(i as usize);
            let (a, b, c) = (at(a)?, at(b)?, at(c)?);
            Some(std::array::from_fn(|k| (1.0 - v - w) * a[k] + v * b[k] + w * c[k]))
        };
        self.face.iter().zip(&self.barycentric).map(|(&face, &b)| value(face, b).unwrap_or(background)).collect()
    }

    pub(crate) fn resize(&mut self, width: u32, height: u32, barycentric: bool) {
        let pixels = width as usize * height as usize;
        (self.width, self.height) = (width, height);
        self.depth.resize(pixels, 0.0);
        self.face.resize(pixels, NO_FACE);
        self.barycentric.resize(if barycentric { pixels } else { 0 }, [0.0; 2]);
    }
}
