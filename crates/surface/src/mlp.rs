//! The meshes of a MeshLab project `.mlp`, each moved by its `MLMatrix44`, as one model.
use std::path::Path;

use nalgebra::Matrix4;

use crate::error::{Error, Place};
use crate::mesh::Mesh;
use crate::part::{Part, assemble};

/// Reads the project and loads its meshes with `load`.
pub(crate) fn read(bytes: &[u8], path: &Path, load: fn(&Path) -> Result<Mesh, Error>) -> Result<Mesh, Error> {
    let text = String::from_utf8_lossy(bytes);
    let syntax = |line: u32, cause: String| {
        let place = Place::Line(u64::from(line));
        Error::Syntax { path: path.to_owned(), place, cause }
    };
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
    let document = roxmltree::Document::parse_with_options(&text, options)
        .map_err(|error| syntax(error.pos().row, format!("is not well-formed XML: {error}")))?;
    let line = |node: &roxmltree::Node| document.text_pos_at(node.range().start).row;
    let mut parts = Vec::new();
    for node in document.descendants().filter(|node| node.has_tag_name("MLMesh")) {
        let missing = || syntax(line(&node), "<MLMesh> lacks the attribute filename".into());
        let file = path.with_file_name(node.attribute("filename").ok_or_else(missing)?);
        if file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mlp")) {
            return Err(syntax(line(&node), "field filename: a project cannot be part of a project".into()));
        }
        if !file.exists() {
            return Err(syntax(line(&node), format!("field filename: there is no {}", file.display())));
        }
        let matrix = node.children().find(|child| child.has_tag_name("MLMatrix44"));
        let matrix = matrix.map(|matrix| {
            let words = matrix.text().unwrap_or_default().split_whitespace();
            let numbers: Option<Vec<f64>> =
                words.map(|word| word.parse().ok().filter(|x: &f64| x.is_finite())).collect();
            let numbers =
                numbers.filter(|numbers| numbers.len() == 16 && numbers[12..15] == [0.0; 3] && numbers[15] == 1.0);
            let cause = "field MLMatrix44: is not an affine matrix of 16 numbers";
            numbers.map(|n| Matrix4::from_row_slice(&n)).ok_or_else(|| syntax(line(&matrix), cause.into()))
        });
        let part = Part::of(load(&file)?);
        parts.push(part.moved(&matrix.transpose()?.unwrap_or_else(Matrix4::identity)));
    }
    if parts.is_empty() {
        return Err(syntax(1, "the project has no mesh".into()));
    }
    assemble(parts).map_err(|defect| Error::Defect { path: path.to_owned(), place: None, defect })
}
