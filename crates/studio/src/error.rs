//! Why a studio cannot be opened.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

use texreg_formats::FileError;

/// Why a studio cannot be opened, in one line that names the cause and what to do.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file of the project is broken or cannot be written.
    #[error(transparent)]
    File(#[from] FileError),
    /// Two photos have the same name.
    #[error("{}: another photo has the same name; rename it, or open them apart", .0.display())]
    SameName(PathBuf),
    /// A photo cannot be opened.
    #[error("{}: {}; check the path of the photo", path.display(), words(source))]
    Photo {
        /// The photo.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The folder cannot be written to.
    #[error("{}: the output folder cannot be written ({}); choose another with -o DIR", folder.display(), words(source))]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Another studio is at work in the folder.
    #[error("{}: another studio is open on this folder; close it, or choose another folder with -o DIR", .0.display())]
    Taken(PathBuf),
    /// The address cannot be listened at.
    #[error("{address}: cannot be listened at ({}); choose another with --port N", words(source))]
    Address {
        /// The address.
        address: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// The system gives no random numbers, threads or sockets.
    #[error("the page cannot be served ({0})")]
    System(String),
}

/// A system error in the words of a sentence, without its number.
fn words(error: &io::Error) -> String {
    let text = error.to_string();
    text.split(" (os error").next().unwrap_or_default().to_lowercase()
}
