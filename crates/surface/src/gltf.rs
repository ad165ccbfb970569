//! glTF 2.0, text and binary, read by the `gltf` crate: the triangles of all meshes of its scene, moved by the nodes' transforms.
//!
//! Units and axes stay as they are. Texture images, skins and animations are read past.
use std::path::Path;

use base64::Engine as _;
use gltf::accessor::{DataType, Dimensions};
use gltf::buffer::Source;
use gltf::mesh::Mode;
use gltf::scene::Transform;
use gltf::{Accessor, Node, Primitive};
use nalgebra::Matrix4;

use crate::error::Error;
use crate::mesh::{Attributes, Mesh};
use crate::part::{Part, assemble};

/// Reads the model in a `.glb`, or in a `.gltf` and the buffers beside it.
pub(crate) fn read(bytes: &[u8], path: &Path) -> Result<Mesh, Error> {
    let damaged = |cause: String| Error::damaged(path, &cause);
    let gltf::Gltf { document, mut blob } =
        gltf::Gltf::from_slice(bytes).map_err(|error| damaged(error.to_string()))?;
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        let bytes = match buffer.source() {
            Source::Bin => blob.take().ok_or("its binary chunk is missing".to_owned()),
            Source::Uri(uri) => fetch(uri, path),
        };
        let bytes = bytes.map_err(|cause| damaged(format!("buffer {}: {cause}", buffer.index())))?;
        if bytes.len() < buffer.length() {
            return Err(damaged(format!(
                "buffer {}: is {} bytes long, not {}",
                buffer.index(),
                bytes.len(),
                buffer.length()
            )));
        }
        buffers.push(bytes);
    }
    let mut scene = Scene { buffers, parts: Vec::new(), deepest: document.nodes().len() };
    let shown = document.default_scene().or_else(|| document.scenes().next());
    for node in shown.iter().flat_map(gltf::Scene::nodes) {
        scene.add(&node, &Matrix4::identity(), 0).map_err(damaged)?;
    }
    assemble(scene.parts).map_err(|defect| Error::Defect { path: path.to_owned(), place: None, defect })
}

/// The bytes of a buffer: in the text itself, or in a file beside it.
fn fetch(uri: &str, path: &Path) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (_, text) = data.split_once(";base64,").ok_or("its data are not in base 64")?;
        return base64::engine::general_purpose::STANDARD
            .decode(text)
            .map_err(|error| format!("its data are damaged: {error}"));
    }
    if uri.contains("://") || Path::new(uri).components().any(|part| !matches!(part, std::path::Component::Normal(_))) {
        return Err(format!("'{uri}' is not the name of a file beside the model"));
    }
    std::fs::read(path.with_file_name(uri)).map_err(|error| format!("'{uri}' cannot be read ({error})"))
}

struct Scene {
    buffers: Vec<Vec<u8>>,
    parts: Vec<Part>,
    /// How deep nodes can be nested where none is its own ancestor.
    deepest: usize,
}

impl Scene {
    fn add(&mut self, node: &Node, world_from_parent: &Matrix4<f64>, depth: usize) -> Result<(), String> {
        if depth > self.deepest {
            return Err(format!("node {}: is its own ancestor", node.index()));
        }
        if let Transform::Decomposed { rotation, .. } = node.transform()
            && rotation.iter().map(|x| x * x).sum::<f32>() < 1e-12
        {
            return Err(format!(
                "node {}, field rotation: is a quaternion of norm zero, which is no rotation",
                node.index()
            ));
        }
        let local = Matrix4::from(node.transform().matrix()).map(f64::from);
        let world_from_node = world_from_parent * local;
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            let fail = |cause| format!("node {}, primitive {}: {cause}", node.index(), primitive.index());
            if let Some(part) = self.part(&primitive).map_err(fail)? {
                self.parts.push(part.moved(&world_from_node));
            }
        }
        node.children().try_for_each(|child| self.add(&child, &world_from_node, depth + 1))
    }

    /// The triangles of a primitive; `None` for points and lines.
    fn part(&self, primitive: &Primitive) -> Result<Option<Part>, String> {
        if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            return Ok(None);
        }
        let vectors = |semantic: gltf::Semantic, name: &str| -> Result<bool, String> {
            let Some(accessor) = primitive.get(&semantic) else { return Ok(false) };
            let is_plain = accessor.data_type() == DataType::F32 && accessor.dimensions() == Dimensions::Vec3;
            self.check(&accessor)
                .and_then(|()| if is_plain { Ok(true) } else { Err("is no list of vectors".into()) })
                .map_err(|cause| format!("{name}: {cause}"))
        };
        if !vectors(gltf::Semantic::Positions, "POSITION")? {
            return Ok(None);
        }
        let reader = primitive.reader(|buffer| self.buffers.get(buffer.index()).map(Vec::as_slice));
        let points: Vec<[f64; 3]> = reader.read_positions().into_iter().flatten().map(|p| p.map(f64::from)).collect();
        let normals = vectors(gltf::Semantic::Normals, "NORMAL")?;
        let normals = normals.then(|| reader.read_normals().into_iter().flatten().collect());
        let colours = match primitive.get(&gltf::Semantic::Colors(0)) {
            Some(accessor) => {
                self.check(&accessor).map_err(|cause| format!("COLOR_0: {cause}"))?;
                let kinds = matches!(accessor.data_type(), DataType::U8 | DataType::U16 | DataType::F32);
                let dimensions = matches!(accessor.dimensions(), Dimensions::Vec3 | Dimensions::Vec4);
                if !kinds || !dimensions {
                    return Err("COLOR_0: are no colours of floats or unsigned integers".into());
                }
                reader.read_colors(0).map(|colours| colours.into_rgb_u8().collect::<Vec<_>>())
            }
            None => None,
        };
        let indices: Vec<u32> = match primitive.indices() {
            Some(accessor) => {
                self.check(&accessor).map_err(|cause| format!("indices: {cause}"))?;
                let kinds = matches!(accessor.data_type(), DataType::U8 | DataType::U16 | DataType::U32);
                if !kinds || accessor.dimensions() != Dimensions::Scalar {
                    return Err("indices: are no whole numbers".into());
                }
                reader.read_indices().into_iter().flat_map(gltf::mesh::util::ReadIndices::into_u32).collect()
            }
            None => (0..points.len() as u32).collect(),
        };
        let triangles: Vec<[u32; 3]> = match primitive.mode() {
            Mode::TriangleStrip => {
                let turned = |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] };
                indices.windows(3).enumerate().map(turned).collect()
            }
            Mode::TriangleFan => {
                indices.get(1..).unwrap_or_default().windows(2).map(|w| [indices[0], w[0], w[1]]).collect()
            }
            _ => indices.as_chunks().0.to_vec(),
        };
        let uvs = match primitive.get(&gltf::Semantic::TexCoords(0)) {
            Some(accessor) => {
                self.check(&accessor).map_err(|cause| format!("TEXCOORD_0: {cause}"))?;
                let kinds = matches!(accessor.data_type(), DataType::U8 | DataType::U16 | DataType::F32);
                if !kinds || accessor.dimensions() != Dimensions::Vec2 || accessor.count() != points.len() {
                    return Err("TEXCOORD_0: are no pairs of floats or unsigned integers, one a vertex".into());
                }
                let uvs = reader.read_tex_coords(0).into_iter().flat_map(gltf::mesh::util::ReadTexCoords::into_f32);
                let by_vertex: Vec<[f32; 2]> = uvs.collect();
                // An index beyond the vertices is told of when the mesh is put together.
                let uv = |&i: &u32| by_vertex.get(i as usize).copied().unwrap_or_default();
                Some(triangles.iter().map(|t| [uv(&t[0]), uv(&t[1]), uv(&t[2])]).collect())
            }
            None => None,
        };
        let attributes = Attributes { normals, colours, uvs, ..Attributes::default() };
        Ok(Some(Part { points, triangles, attributes, ..Part::default() }))
    }

    /// Makes sure that an accessor stays within its buffer: the crate takes its word for it.
    fn check(&self, accessor: &Accessor) -> Result<(), String> {
        if accessor.sparse().is_some() {
            return Err("sparse data are not supported".into());
        }
        let view = accessor.view().ok_or("has no data")?;
        let stride = view.stride().unwrap_or(accessor.size());
        let length = self.buffers.get(view.buffer().index()).map_or(0, Vec::len);
        let fits = |offset: usize, size: Option<usize>, within: usize| {
            size.and_then(|size| offset.checked_add(size)).is_some_and(|end| end <= within)
        };
        let span = accessor.count().checked_sub(1).and_then(|n| n.checked_mul(stride)?.checked_add(accessor.size()));
        if stride < accessor.size()
            || !fits(view.offset(), Some(view.length()), length)
            || !fits(accessor.offset(), span, view.length())
        {
            return Err("reaches beyond its buffer".into());
        }
        Ok(())
    }
}
