//! What can go wrong in a registration.

/// Why a photo could not be registered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// The camera looks past the model, or has it behind itself.
    #[error("the model is not in sight of the starting camera; check its pose, or start from correspondences")]
    NothingVisible,
    /// A signal was asked for that the model does not carry.
    #[error("the model has no reflectance; leave out the signal 'reflectance'")]
    NoReflectance,
    /// The observer said stop.
    #[error("the registration was stopped")]
    Stopped,
}
