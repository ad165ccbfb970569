//! glTF 2.0 in its binary form, GLB (Khronos Group, *glTF 2.0 Specification*, 2021, §4.4).

use crate::split::Split;
use crate::{Error, Texture, png};
use rayon::prelude::*;
use serde_json::{Value, json};
use texreg_surface::Mesh;

/// A glTF asset with one buffer: its JSON, to which nodes and cameras may be added, and the buffer.
#[derive(Clone, Debug, PartialEq)]
pub struct Glb {
    /// The asset; `buffers` is filled in by [`bytes`](Self::bytes).
    pub json: Value,
    /// The buffer.
    pub buffer: Vec<u8>,
}

impl Glb {
    /// A textured mesh. Its material is unlit, for the photos' light is in the texture; viewers that do not know of unlit
    /// materials take it as rough and not metallic. Positions stay relative to the mesh's origin, which is the node's
    /// translation: single precision keeps its detail at survey coordinates. Axes and units are the model's.
    ///
    /// # Errors
    /// [`Error::Image`] if the texture cannot be encoded.
    pub fn new(mesh: &Mesh, texture: &Texture) -> Result<Self, Error> {
        let split = Split::new(mesh, texture);
        let at = |values: &[[f32; 3]]| split.vertices.par_iter().map(|&v| values[v as usize]).collect::<Vec<_>>();
        let (positions, normals) = (at(&mesh.positions), at(&mesh.normals));
        let bound = |pick: fn(f32, f32) -> f32| -> [f32; 3] {
            positions.iter().copied().reduce(|a, b| std::array::from_fn(|k| pick(a[k], b[k]))).unwrap_or_default()
        };
        let mut buffer = Vec::new();
        let mut views = Vec::new();
        let mut view = |bytes: &mut dyn Iterator<Item = [u8; 4]>, target: Option<u32>| {
            let start = buffer.len();
            buffer.extend(bytes.flatten());
            let mut view = json!({"buffer": 0, "byteOffset": start, "byteLength": buffer.len() - start});
            if let Some(target) = target {
                view["target"] = json!(target);
            }
            views.push(view);
        };
        const VERTICES: Option<u32> = Some(34_962);
        const INDICES: Option<u32> = Some(34_963);
        const FLOAT: u32 = 5126;
        const UNSIGNED_INT: u32 = 5125;
        view(&mut positions.as_flattened().iter().map(|x| x.to_le_bytes()), VERTICES);
        view(&mut normals.as_flattened().iter().map(|x| x.to_le_bytes()), VERTICES);
        view(&mut split.uvs.as_flattened().iter().map(|x| x.to_le_bytes()), VERTICES);
        view(&mut split.triangles.as_flattened().iter().map(|i| i.to_le_bytes()), INDICES);
        let picture = png(&texture.image)?;
        let start = buffer.len();
        buffer.extend_from_slice(&picture);
        views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": picture.len()}));
        let count = split.vertices.len();
        let json = json!({
            "asset": {"version": "2.0", "generator": concat!("texreg ", env!("CARGO_PKG_VERSION"))},
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"name": "model", "mesh": 0, "translation": <[f64; 3]>::from(mesh.origin)}],
            "meshes": [{"name": "model", "primitives": [{
                "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}, "indices": 3, "material": 0}]}],
            "materials": [{
                "name": "photos",
                "doubleSided": true,
                "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": 1.0},
                "extensions": {"KHR_materials_unlit": {}}}],
            "textures": [{"sampler": 0, "source": 0}],
            "samplers": [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}],
            "images": [{"bufferView": 4, "mimeType": "image/png"}],
            "accessors": [
                {"bufferView": 0, "componentType": FLOAT, "count": count, "type": "VEC3",
                 "min": bound(f32::min), "max": bound(f32::max)},
                {"bufferView": 1, "componentType": FLOAT, "count": count, "type": "VEC3"},
                {"bufferView": 2, "componentType": FLOAT, "count": count, "type": "VEC2"},
                {"bufferView": 3, "componentType": UNSIGNED_INT, "count": 3 * split.triangles.len(), "type": "SCALAR"}],
            "bufferViews": views,
        });
        Ok(Self { json, buffer })
    }

    /// The file.
    ///
    /// # Errors
    /// [`Error::TooLarge`] beyond four gibibytes, which the format cannot count.
    pub fn bytes(mut self) -> Result<Vec<u8>, Error> {
        pad(&mut self.buffer, 0);
        self.json["buffers"] = json!([{"byteLength": self.buffer.len()}]);
        let mut text = self.json.to_string().into_bytes();
        pad(&mut text, b' ');
        let length = 12 + 8 + text.len() + 8 + self.buffer.len();
        let total = u32::try_from(length).map_err(|_| Error::TooLarge { bytes: length as u64 })?;
        let mut file = Vec::with_capacity(length);
        file.extend_from_slice(b"glTF");
        for (chunk, kind) in [(&text, b"JSON"), (&self.buffer, b"BIN\0")] {
            if file.len() == 4 {
                file.extend_from_slice(&2u32.to_le_bytes());
                file.extend_from_slice(&total.to_le_bytes());
            }
            file.extend_from_slice(&(chunk.len() as u32).to_le_bytes());
            file.extend_from_slice(kind);
            file.extend_from_slice(chunk);
        }
        Ok(file)
    }
}

/// Fills up to a multiple of four.
fn pad(bytes: &mut Vec<u8>, with: u8) {
    bytes.resize(bytes.len().next_multiple_of(4), with);
}
