//! Running the binary, and finding data.

use std::path::{Path, PathBuf};
use std::process::Command;

/// What came of a run.
#[derive(Debug)]
pub(crate) struct Run {
    /// The exit status, -1 after a signal.
    pub(crate) status: i32,
    /// Standard output.
    pub(crate) stdout: String,
    /// Standard error.
    pub(crate) stderr: String,
}

/// Runs `texreg` in a folder.
pub(crate) fn run<S: AsRef<std::ffi::OsStr>>(folder: &Path, args: &[S]) -> Run {
    let args = args.iter().map(AsRef::as_ref).filter(|arg| !arg.is_empty());
    let output = Command::new(env!("CARGO_BIN_EXE_texreg")).args(args).current_dir(folder).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Run { status: output.status.code().unwrap_or(-1), stdout: text(output.stdout), stderr: text(output.stderr) }
}

/// A file of the fixture.
pub(crate) fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/nefertiti").join(name)
}
