//! What can go wrong in a registration.
use texreg_surface::NoSuchSignal;

/// Why a photo could not be registered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// The camera looks past the model, or has it behind itself.
    #[error("the model is not in sight of the starting camera; check its pose, or start from correspondences")]
    NothingVisible,
    /// A signal was asked for that the model does not carry.
    #[error(transparent)]
    NoSuchSignal(#[from] NoSuchSignal),
    /// The observer said stop.
    #[error("the registration was stopped")]
    Stopped,
}
