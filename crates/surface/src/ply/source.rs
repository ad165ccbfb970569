//! Where the bytes of a model come from: a file, read at any offset by any thread, or memory.
//!
//! Reading in chunks costs about as much as mapping, and a mapped file that shrinks while it is read kills the process.
use std::fs::File;
use std::io;

/// A readable range of bytes of known length.
pub(crate) enum Source<'a> {
    /// A regular file and its length.
    File(File, u64),
    /// Bytes in memory.
    Bytes(&'a [u8]),
}

impl Source<'_> {
    /// The regular file of this length.
    pub(crate) fn file(file: File, length: u64) -> Source<'static> {
        Source::File(file, length)
    }

    /// The number of bytes there are.
    pub(crate) fn length(&self) -> u64 {
        match self {
            Source::File(_, length) => *length,
            Source::Bytes(bytes) => bytes.len() as u64,
        }
    }

    /// Fills `buffer` with the `length` bytes from `offset` on and returns them.
    pub(crate) fn read<'b>(&self, offset: u64, length: usize, buffer: &'b mut Vec<u8>) -> io::Result<&'b [u8]> {
        if buffer.len() < length {
            buffer.resize(length, 0);
        }
        let target = &mut buffer[..length];
        match self {
            Source::File(file, _) => read_exact_at(file, target, offset)?,
            Source::Bytes(bytes) => {
                let from = usize::try_from(offset).ok().and_then(|start| bytes.get(start..)?.get(..length));
                target.copy_from_slice(from.ok_or(io::ErrorKind::UnexpectedEof)?);
            }
        }
        Ok(target)
    }
}

#[cfg(unix)]
fn read_exact_at(file: &File, buffer: &mut [u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, buffer, offset)
}

#[cfg(windows)]
fn read_exact_at(file: &File, mut buffer: &mut [u8], mut offset: u64) -> io::Result<()> {
    while !buffer.is_empty() {
        let count = std::os::windows::fs::FileExt::seek_read(file, buffer, offset)?;
        if count == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        buffer = &mut buffer[count..];
        offset += count as u64;
    }
    Ok(())
}
