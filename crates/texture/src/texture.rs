//! From cameras and photos to a texture, photo by photo: memory holds one photo and the texture, however many photos there are.

use crate::Error;
use crate::atlas::{Atlas, SurfacePoint};
use crate::bands::{Bands, Pixels};
use crate::blend::{Blend, Mixture};
use crate::consensus::{CELL, Cells, Observations, gains, surroundings, table, trust};
use crate::inpaint::spread;
use crate::sight::Sight;
use image::{GrayImage, Luma, Rgb, RgbImage};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use texreg_camera::View;
use texreg_raster::Renderer;
use texreg_surface::Mesh;

/// What marks texels no photo sees.
const MARK: [u8; 3] = [255, 0, 255];

/// A photo's camera, and how good it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// The camera and its place in the world.
    pub view: View,
    /// The weight of the photo against others, above zero; 1 for one as good as any.
    pub trust: f64,
    /// How far, in pixels, the surface may be from where the view puts it. Surfaces so near to an edge are not used.
    pub uncertainty: f64,
}

/// What becomes of texels that no photo sees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Unseen {
    /// Colours spread into them over the surface.
    #[default]
    Inpaint,
    /// They are magenta.
    Mark,
}

/// How to make a texture.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// The texture's width and height in texels; without it, as many as the photos have pixels on the surface, up to `limit`.
    pub size: Option<u32>,
    /// The greatest width and height without `size`.
    pub limit: u32,
    /// How photos are blended.
    pub blend: Blend,
    /// What becomes of texels that no photo sees.
    pub unseen: Unseen,
    /// Whether exposure and white balance are matched between the photos.
    pub balance: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { size: None, limit: 8192, blend: Blend::default(), unseen: Unseen::default(), balance: true }
    }
}

/// A texture and where it lies on a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// The texture (sRGB).
    pub image: RgbImage,
    /// Texture coordinates (u, v) of the three corners of each triangle; (0, 0) is the top left corner of the image.
    pub uvs: Vec<[[f32; 2]; 3]>,
}

/// What [`texture`] hands back.
#[derive(Clone, Debug)]
pub struct Textured {
    /// The texture.
    pub texture: Texture,
    /// The colours of the vertices (sRGB).
    pub colours: Vec<[u8; 3]>,
    /// The texels that some photo sees: white on black.
    pub seen: GrayImage,
    /// The share of the texels on the surface that some photo sees, 0 to 1.
    pub seen_share: f64,
    /// The charts that were cut; zero where the model's own texture coordinates serve.
    pub charts: usize,
    /// For each photo the gain of red, green and blue in linear light.
    pub gains: Vec<[f64; 3]>,
    /// For each photo the share of the texels it sees.
    pub shares: Vec<f64>,
}

/// Textures a mesh with photos. `load` is asked for the pixels of each photo, by index, twice.
///
/// # Errors
/// Those of `load`, and [`Error::Size`] if it hands back a photo that is not of its camera's size; [`Error::NothingSeen`]
/// if no photo sees the model.
pub fn texture<E: From<Error>>(
    mesh: &Mesh,
    sources: &[Source],
    mut load: impl FnMut(usize) -> Result<Pixels, E>,
    options: &Options,
) -> Result<Textured, E> {
    let mut renderer = Renderer::new();
    let mut seen = vec![false; mesh.triangles.len()];
    let density = density(mesh, sources, &mut renderer, &mut seen);
    if density.iter().all(|d| *d == 0.0) {
        return Err(Error::NothingSeen.into());
    }
    let atlas = Atlas::own(mesh, &density, options.size, options.limit)
        .unwrap_or_else(|| Atlas::cut(mesh, &density, options.size, options.limit));

    let cells = Cells::new(&atlas);
    let mut observations = Vec::new();
    for (i, source) in sources.iter().enumerate() {
        let sight = Sight::new(mesh, source, &mut renderer, &mut seen);
        let pixels = checked(load(i)?, i, source)?;
        observations.push(observe(mesh, &atlas, &cells, &sight, pixels));
    }
    let gains = if options.balance { gains(&observations) } else { vec![[1.0; 3]; sources.len()] };
    let tables: Vec<[[f32; 256]; 3]> = gains.iter().map(|gain| gain.map(table)).collect();
    let surroundings = surroundings(mesh, &atlas, &cells, &observations, &tables);
    let trust = trust(&observations, &tables, &surroundings, &cells);
    drop(observations);

    let texels = atlas.texels();
    let mut mixtures = vec![Mixture::default(); texels.len()];
    let vertices = Vertices::new(mesh, &atlas);
    let mut vertex_mixtures = vec![Mixture::default(); mesh.positions.len()];
    let mut shares = Vec::new();
    for (i, source) in sources.iter().enumerate() {
        let sight = Sight::new(mesh, source, &mut renderer, &mut seen);
        let bands = Bands::new(checked(load(i)?, i, source)?, &sight, tables[i]);
        let add = |mixture: &mut Mixture, at: &SurfacePoint, texel: u32| {
            let Some(glimpse) = sight.glimpse(&at.point, &at.normal) else { return 0 };
            let trust = f64::from(trust[i][cells.of(texel)]) / 255.0;
            mixture.add(options.blend, &glimpse, &bands, at.size, trust);
            1
        };
        let texel = |(mixture, &texel): (&mut Mixture, &u32)| {
            if seen[atlas.face[texel as usize] as usize] { add(mixture, &atlas.point(mesh, texel).1, texel) } else { 0 }
        };
        let count: usize = mixtures.par_iter_mut().zip(&texels).with_min_len(1 << 10).map(texel).sum();
        shares.push(count as f64 / texels.len() as f64);
        let vertex = |(v, mixture): (usize, &mut Mixture)| {
            add(mixture, &vertices.point(mesh, v), vertices.texels[v]);
        };
        vertex_mixtures.par_iter_mut().enumerate().with_min_len(1 << 10).for_each(vertex);
    }

    let low: Vec<Option<[f32; 3]>> = vertex_mixtures.iter().map(Mixture::low).collect();
    let spread = spread(mesh, &low);
    let byte = |colour: [f32; 3]| colour.map(|x| x.round().clamp(0.0, 255.0) as u8);
    let fill = |texel: u32| byte(atlas.interpolated(mesh, texel, &spread));
    let colour = |mixture: &Mixture, fill: &dyn Fn() -> [u8; 3]| match (mixture.colour(), options.unseen) {
        (Some(colour), _) => byte(colour),
        (None, Unseen::Inpaint) => fill(),
        (None, Unseen::Mark) => MARK,
    };
    let found: Vec<[u8; 3]> =
        mixtures.par_iter().zip(&texels).map(|(mixture, &texel)| colour(mixture, &|| fill(texel))).collect();
    let colours = vertex_mixtures.iter().zip(&spread).map(|(m, &fill)| colour(m, &|| byte(fill))).collect();
    let mut image = RgbImage::from_pixel(atlas.width, atlas.height, Rgb(mean(&found)));
    let mut seen = GrayImage::new(atlas.width, atlas.height);
    let mut count = 0u32;
    for ((&texel, &colour), mixture) in texels.iter().zip(&found).zip(&mixtures) {
        let (x, y) = (texel % atlas.width, texel / atlas.width);
        image.put_pixel(x, y, Rgb(colour));
        if mixture.colour().is_some() {
            seen.put_pixel(x, y, Luma([u8::MAX]));
            count += 1;
        }
    }
    Ok(Textured {
        texture: Texture { image, uvs: atlas.uvs() },
        colours,
        seen,
        seen_share: f64::from(count) / texels.len().max(1) as f64,
        charts: atlas.charts,
        gains,
        shares,
    })
}

/// The photo, if it is of its camera's size.
fn checked(pixels: Pixels, index: usize, source: &Source) -> Result<Pixels, Error> {
    let camera = &source.view.camera;
    let expected = [camera.width, camera.height];
    let found = [pixels.width, pixels.height];
    if found != expected || pixels.rgb.len() as u64 != u64::from(found[0]) * u64::from(found[1]) {
        return Err(Error::Size { index, expected, found });
    }
    Ok(pixels)
}

/// By face, the greatest number of pixels of a photo that see a model unit of it; 0 where none does.
fn density(mesh: &Mesh, sources: &[Source], renderer: &mut Renderer, seen: &mut [bool]) -> Vec<f32> {
    let mut density = vec![0.0f32; mesh.triangles.len()];
    for source in sources {
        let sight = Sight::new(mesh, source, renderer, seen);
        density.par_iter_mut().zip(&*seen).zip(&mesh.triangles).for_each(|((density, seen), triangle)| {
            if *seen {
                let [a, b, c] = triangle.map(|i| Vector3::from(mesh.positions[i as usize].map(f64::from)));
                let found = sight.density(&Point3::from((a + b + c) / 3.0), &(b - a).cross(&(c - a)));
                *density = density.max(found as f32);
            }
        });
    }
    density
}

/// What a photo shows in each cell.
fn observe(mesh: &Mesh, atlas: &Atlas, cells: &Cells, sight: &Sight, pixels: Pixels) -> Observations {
    let bands = Bands::new(pixels, sight, [std::array::from_fn(|v| v as f32); 3]);
    let observe = |&texel: &u32| {
        if texel == u32::MAX {
            return [0; 4];
        }
        let (_, at) = atlas.point(mesh, texel);
        let Some(glimpse) = sight.glimpse(&at.point, &at.normal) else { return [0; 4] };
        let level = bands.level(f64::from(CELL) * at.size * glimpse.density, glimpse.edge);
        let [r, g, b] = bands.sample(&glimpse.pixel, level).map(|x| x.round().clamp(0.0, 255.0) as u8);
        [r, g, b, u8::MAX]
    };
    cells.texels.par_iter().with_min_len(1 << 8).map(observe).collect()
}

/// The vertices as points to be coloured.
struct Vertices {
    /// A texel at each vertex.
    texels: Vec<u32>,
    /// About the distance to its neighbours, in model units.
    sizes: Vec<f32>,
}

impl Vertices {
    fn new(mesh: &Mesh, atlas: &Atlas) -> Self {
        let mut texels = vec![0; mesh.positions.len()];
        let mut areas = vec![0.0f32; mesh.positions.len()];
        for (triangle, corners) in mesh.triangles.iter().zip(&atlas.corners) {
            let [a, b, c] = triangle.map(|i| Vector3::from(mesh.positions[i as usize]));
            let area = (b - a).cross(&(c - a)).norm() / 6.0;
            for (&i, corner) in triangle.iter().zip(corners) {
                let [x, y] = corner.map(|x| x.round().max(0.0) as u32);
                texels[i as usize] = y.min(atlas.height - 1) * atlas.width + x.min(atlas.width - 1);
                areas[i as usize] += area;
            }
        }
        Self { texels, sizes: areas.into_iter().map(f32::sqrt).collect() }
    }

    fn point(&self, mesh: &Mesh, vertex: usize) -> SurfacePoint {
        SurfacePoint {
            point: Point3::from(mesh.positions[vertex].map(f64::from)),
            normal: Vector3::from(mesh.normals[vertex].map(f64::from)),
            size: f64::from(self.sizes[vertex]),
        }
    }
}

/// The mean colour, which fills what is empty.
fn mean(colours: &[[u8; 3]]) -> [u8; 3] {
    let sum = colours.iter().fold([0u64; 3], |sum, c| std::array::from_fn(|k| sum[k] + u64::from(c[k])));
    sum.map(|x| (x / colours.len().max(1) as u64) as u8)
}
