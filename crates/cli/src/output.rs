//! The folder a run writes to, and what it prints.

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use texreg::formats::write_atomic;

use crate::inputs::cause;

/// The quality of overlay pictures.
const QUALITY: u8 = 88;

/// A folder that can be written to.
pub(crate) struct Output {
    folder: PathBuf,
}

impl Output {
    /// Makes the folder, and makes sure that a file can be put there before any work is done.
    pub(crate) fn open(folder: &Path) -> anyhow::Result<Self> {
        let open = || -> io::Result<()> {
            fs::create_dir_all(folder)?;
            tempfile::tempfile_in(folder)?;
            Ok(())
        };
        open().map_err(|e| {
            let folder = folder.display();
            anyhow::anyhow!("{folder}: the output folder cannot be written ({}); choose another with -o DIR", cause(&e))
        })?;
        Ok(Self { folder: folder.to_owned() })
    }

    /// Where a file of the result is, its name relative to the folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Writes a file of the result, with the folders it needs.
    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> anyhow::Result<()> {
        let path = self.path(name);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(|e| {
                anyhow::anyhow!("{}: cannot be made ({}); choose another with -o DIR", parent.display(), cause(&e))
            })?;
        }
        Ok(write_atomic(&path, bytes)?)
    }
}

/// The name of a photo's overlay in the result.
pub(crate) fn overlay_name(photo: &str) -> String {
    let is_jpeg =
        Path::new(photo).extension().is_some_and(|e| e.eq_ignore_ascii_case("jpg") || e.eq_ignore_ascii_case("jpeg"));
    format!("overlay/{photo}{}", if is_jpeg { "" } else { ".jpg" })
}

/// A picture as a JPEG file.
pub(crate) fn jpeg(picture: &RgbImage) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    picture.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, QUALITY))?;
    Ok(bytes)
}

/// Prints to standard output; a reader that has gone away is no error.
pub(crate) fn print(text: &str) -> io::Result<()> {
    match writeln!(io::stdout().lock(), "{}", text.trim_end_matches('\n')) {
        Err(e) if e.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        other => other,
    }
}

/// Lines of cells as a table, columns two spaces apart; all but the first and the last column are flush right.
pub(crate) fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let cells = |column: usize| rows.iter().filter_map(move |row| row.get(column));
    let widths: Vec<usize> =
        (0..columns).map(|column| cells(column).map(|cell| cell.chars().count()).max().unwrap_or(0)).collect();
    let mut text = String::new();
    for row in rows {
        let mut line = String::new();
        for (column, cell) in row.iter().enumerate() {
            let width = widths[column];
            if column == 0 || column + 1 == columns {
                line += &format!("{cell:width$}  ");
            } else {
                line += &format!("{cell:>width$}  ");
            }
        }
        text += line.trim_end();
        text.push('\n');
    }
    text
}
