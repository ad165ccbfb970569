//! Files as such: what can go wrong with one, and writing it, or several that belong together, whole or not at all.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// A file that could not be read, understood or written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {cause}", path.display())]
pub struct FileError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it, in one line that names the photo and the field where there is one.
    pub cause: String,
}

impl FileError {
    /// An error of a file as a whole.
    pub fn new(path: &Path, cause: impl Into<String>) -> Self {
        Self { path: path.to_owned(), cause: cause.into() }
    }

    /// An error in one line (counted from 1) of a file.
    pub(crate) fn at(path: &Path, line: usize, cause: impl std::fmt::Display) -> Self {
        Self::new(path, format!("line {line}: {cause}"))
    }
}

/// Reads a file whole.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, FileError> {
    fs::read(path).map_err(|e| FileError::new(path, format!("cannot be read ({}); check the path", describe(&e))))
}

/// Reads a file of text.
pub(crate) fn read_text(path: &Path) -> Result<String, FileError> {
    String::from_utf8(read(path)?).map_err(|e| {
        let byte = e.utf8_error().valid_up_to();
        FileError::new(path, format!("byte {byte}: is not text (UTF-8)"))
    })
}

/// Writes `bytes` to `path` all at once: under a temporary name in the same folder, which then takes the place of `path`.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    write_together(&[(path, bytes)])
}

/// Writes several files that belong together: all under temporary names first, which then take their places one after the other,
/// so that a full disk or a folder that cannot be written leaves all of them as they were.
pub fn write_together<P: AsRef<Path>, B: AsRef<[u8]>>(files: &[(P, B)]) -> Result<(), FileError> {
    let stage = |path: &Path, bytes: &[u8]| -> std::io::Result<tempfile::NamedTempFile> {
        if path.is_dir() {
            return Err(std::io::ErrorKind::IsADirectory.into());
        }
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut builder = tempfile::Builder::new();
        builder.prefix(".texreg-");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        let mut file = builder.tempfile_in(folder)?;
        file.write_all(bytes)?;
        Ok(file)
    };
    let failed = |path: &Path, e: &std::io::Error| FileError::new(path, format!("cannot be written ({})", describe(e)));
    let staged: Vec<_> = files
        .iter()
        .map(|(path, bytes)| (path.as_ref(), bytes.as_ref()))
        .map(|(path, bytes)| stage(path, bytes).map(|file| (path, file)).map_err(|e| failed(path, &e)))
        .collect::<Result<_, _>>()?;
    staged.into_iter().try_for_each(|(path, file)| file.persist(path).map(drop).map_err(|e| failed(path, &e.error)))
}

/// A system error in the words of a sentence, without tempfile's path and the error's number.
fn describe(error: &std::io::Error) -> String {
    let text = match error.raw_os_error() {
        Some(code) => std::io::Error::from_raw_os_error(code).to_string(),
        None => error.kind().to_string(),
    };
    text.split(" (os error").next().unwrap_or_default().to_lowercase()
}
