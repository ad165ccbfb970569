//! What can go wrong with a texture.

/// Why there is no texture.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// A photo is not of its camera's size.
    #[error("photo {index} has {} × {} pixels, its camera {} × {}", found[0], found[1], expected[0], expected[1])]
    Size {
        /// The photo, counted from zero.
        index: usize,
        /// The camera's width and height.
        expected: [u32; 2],
        /// The photo's.
        found: [u32; 2],
    },
    /// No camera sees the model.
    #[error("no camera sees the model")]
    NothingSeen,
    /// A picture cannot be encoded.
    #[error("the texture cannot be encoded ({cause}); choose a smaller size")]
    Image {
        /// What the encoder said.
        cause: String,
    },
    /// The file would be larger than its format can say.
    #[error("the GLB would have {bytes} bytes, more than its format can count; choose a smaller size")]
    TooLarge {
        /// Bytes the file would have.
        bytes: u64,
    },
}
