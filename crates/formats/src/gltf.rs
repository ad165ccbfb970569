//! Cameras as glTF 2.0 has them (Khronos, section 5.12): a node that looks along −z with y up, and a symmetric perspective.
//!
//! A binary glTF that is there already, such as a textured model, keeps all it has and gets the cameras added.

use crate::rotation::FLIP;
use crate::{FileError, Scene, base_name};
use nalgebra::Matrix3;
use serde_json::{Map, Value, json};
use std::path::Path;

const MAGIC: &[u8; 4] = b"glTF";
const JSON_CHUNK: u32 = 0x4E4F_534A;

/// The bytes of a GLB with the scene's cameras, and of what `base` (the bytes of another GLB) holds.
pub(crate) fn write(path: &Path, scene: &Scene, base: Option<&[u8]>) -> Result<Vec<u8>, FileError> {
    let (mut root, rest) = match base {
        Some(bytes) => split(bytes).map_err(|cause| FileError::new(path, cause))?,
        None => (
            json!({"asset": {"version": "2.0", "generator": "texreg"}, "scene": 0, "scenes": [{"nodes": []}]}),
            &[][..],
        ),
    };
    let malformed =
        || FileError::new(path, "is no glTF that cameras can be added to: its scenes or nodes are malformed");
    let shown = root.get("scene").and_then(Value::as_u64).unwrap_or(0) as usize;
    let object = root.as_object_mut().ok_or_else(malformed)?;
    for (entry, size) in scene.cameras.photos.iter().zip(scene.sizes(path)?) {
        let k = entry.lens.camera(size).intrinsics;
        let [w, h] = size.map(f64::from);
        let name = base_name(&entry.file);
        let inverse = entry.pose.inverse();
        let r: Matrix3<f64> = inverse.rotation.matrix() * FLIP;
        let t = inverse.translation;
        let column = |j: usize| [r[(0, j)], r[(1, j)], r[(2, j)], 0.0];
        let matrix = [column(0), column(1), column(2), [t.x, t.y, t.z, 1.0]].concat();
        let far = 100.0 * entry.pose.translation.norm().max(1e-9);
        let perspective = json!({
            "aspectRatio": (w / k.fx) / (h / k.fy), "yfov": 2.0 * (0.5 * h / k.fy).atan(), "znear": 1e-4 * far, "zfar": far
        });
        let camera = push(object, "cameras", json!({"name": name, "type": "perspective", "perspective": perspective}));
        let camera = camera.ok_or_else(malformed)?;
        let node =
            push(object, "nodes", json!({"name": name, "camera": camera, "matrix": matrix})).ok_or_else(malformed)?;
        let scenes = object.get_mut("scenes").and_then(|scenes| scenes.get_mut(shown)).and_then(Value::as_object_mut);
        push(scenes.ok_or_else(malformed)?, "nodes", json!(node)).ok_or_else(malformed)?;
    }
    let mut text = root.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut out = MAGIC.to_vec();
    out.extend(2u32.to_le_bytes());
    out.extend(((20 + text.len() + rest.len()) as u32).to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(JSON_CHUNK.to_le_bytes());
    out.extend(text);
    out.extend(rest);
    Ok(out)
}

/// Adds a value to the list of this name and tells its index.
fn push(object: &mut Map<String, Value>, key: &str, value: Value) -> Option<usize> {
    let list = object.entry(key).or_insert_with(|| json!([])).as_array_mut()?;
    list.push(value);
    Some(list.len() - 1)
}

/// The JSON of a GLB, and the chunks behind it.
fn split(bytes: &[u8]) -> Result<(Value, &[u8]), String> {
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    if bytes.get(..4) != Some(MAGIC) || word(4) != Some(2) || word(16) != Some(JSON_CHUNK) {
        return Err("byte 0: is not a binary glTF of version 2".into());
    }
    let end = word(12).and_then(|length| 20usize.checked_add(length as usize));
    let json = end.and_then(|end| bytes.get(20..end)).ok_or("byte 12: the JSON chunk is cut off")?;
    let value = serde_json::from_slice(json).map_err(|e| format!("its JSON chunk is malformed: {e}"))?;
    Ok((value, &bytes[20 + json.len()..]))
}
