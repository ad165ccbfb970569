//! Bundler's `.out`: N. Snavely's *Bundler v0.4 User's Manual*. Cameras look along −z with y up, the image's origin is its centre;
//! the photos' names stand in a list beside it, one a line.

use crate::file::read_text;
use crate::rotation::{FLIP, checked_rotation};
use crate::xml::{numbers, shortened};
use crate::{CameraEntry, FileError, Lens, Scene};
use nalgebra::{Matrix3, RowVector3, Vector3};
use serde_json::Map;
use std::fmt::Write as _;
use std::iter::Enumerate;
use std::path::{Path, PathBuf};
use std::str::Lines;
use texreg_camera::Distortion;
use texreg_lie::Pose;

/// The names of the list of photos that are looked for beside a file.
fn lists(path: &Path) -> [PathBuf; 2] {
    [path.with_extension("list.txt"), path.with_file_name("list.txt")]
}

/// Where the list of photos of a file is written.
pub(crate) fn list_path(path: &Path) -> PathBuf {
    path.with_extension("list.txt")
}

pub(crate) fn read(path: &Path, text: &str) -> Result<Scene, FileError> {
    let found = lists(path).into_iter().find(|list| list.exists());
    let list = found
        .ok_or_else(|| FileError::new(path, "the list of its photos is missing; put it beside the file as list.txt"))?;
    let names = read_text(&list)?;
    // A list may say more behind a name: the image's kind and its focal length.
    let names: Vec<&str> = names.lines().filter_map(|line| line.split_whitespace().next()).collect();

    let mut rows = Rows { path, lines: text.lines().enumerate(), line: 0 };
    if !rows.next().is_some_and(|header| header.starts_with("# Bundle file")) {
        return Err(FileError::at(path, 1, "a Bundler file begins with '# Bundle file v0.3'"));
    }
    let [cameras, _] = rows.numbers("the numbers of cameras and points")?;
    let cameras = cameras as usize;
    if cameras > names.len() {
        let cause = format!("has {cameras} cameras, but {} names {} photos", list.display(), names.len());
        return Err(rows.error(cause));
    }
    let mut scene = Scene::default();
    for file in &names[..cameras] {
        let field = |what: &str| format!("photo {file}, field {what}");
        let [f, k1, k2] = rows.numbers(&field("f k1 k2"))?;
        if f < 0.0 {
            return Err(rows.error(format!("{}: must be positive", field("f"))));
        }
        let mut r = Matrix3::zeros();
        for i in 0..3 {
            r.set_row(i, &RowVector3::from(rows.numbers::<3>(&field("R"))?));
        }
        let r = (f > 0.0).then(|| checked_rotation(&(FLIP * r)));
        let r = r.transpose().map_err(|cause| rows.error(format!("{}: {cause}", field("R"))))?;
        let t = rows.numbers::<3>(&field("t"))?;
        let Some(r) = r else {
            scene.warnings.push(format!("photo {file}: Bundler did not place it"));
            continue;
        };
        scene.cameras.photos.push(CameraEntry {
            file: (*file).to_owned(),
            lens: Lens {
                size: None,
                focal: [f; 2],
                principal: [None; 2],
                skew: 0.0,
                distortion: Distortion::from([k1, k2, 0.0, 0.0, 0.0]),
            },
            pose: Pose::new(r, FLIP * Vector3::from(t)),
            other: Map::new(),
        });
    }
    Ok(scene)
}

/// The lines of a file that are not empty, one after the other.
struct Rows<'a> {
    path: &'a Path,
    lines: Enumerate<Lines<'a>>,
    /// The number of the last line, from 1.
    line: usize,
}

impl<'a> Rows<'a> {
    fn next(&mut self) -> Option<&'a str> {
        let (index, text) = self.lines.find(|(_, line)| !line.trim().is_empty())?;
        self.line = index + 1;
        Some(text)
    }

    fn numbers<const N: usize>(&mut self, field: &str) -> Result<[f64; N], FileError> {
        let text = self.next().ok_or_else(|| self.error(format!("the file ends before {field}")))?;
        let found = numbers(text).and_then(|numbers| numbers.try_into().ok());
        found.ok_or_else(|| self.error(format!("{field}: '{}' is not {N} numbers", shortened(text))))
    }

    fn error(&self, cause: impl std::fmt::Display) -> FileError {
        FileError::at(self.path, self.line, cause)
    }
}

/// The file, and the list of photos.
pub(crate) fn write(path: &Path, scene: &Scene) -> Result<(String, String), FileError> {
    let mut out = format!("# Bundle file v0.3\n{} 0\n", scene.cameras.photos.len());
    let mut list = String::new();
    for entry in &scene.cameras.photos {
        if entry.file.contains(char::is_whitespace) {
            let cause =
                format!("photo {}: Bundler's list of photos cannot hold names with spaces; rename it", entry.file);
            return Err(FileError::new(path, cause));
        }
        let d = entry.lens.distortion.to_array();
        let _ = writeln!(out, "{} {} {}", entry.lens.focal[0], d[0], d[1]);
        let r = FLIP * entry.pose.rotation.matrix();
        let t = FLIP * entry.pose.translation;
        for row in r.row_iter() {
            let _ = writeln!(out, "{} {} {}", row[0], row[1], row[2]);
        }
        let _ = writeln!(out, "{} {} {}", t.x, t.y, t.z);
        let _ = writeln!(list, "{}", entry.file);
    }
    Ok((out, list))
}
