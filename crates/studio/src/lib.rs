//! The local web page of texreg: picking pairs of model points and pixels, watching a registration, judging what came of it.
//!
//! [`Studio::open`] opens a project, [`serve`] serves its page. The state lives here, one project behind a lock, saved at every
//! change; the page draws it and says what people do. What it shows of the model are pictures made here, so that a browser is
//! all that is needed.

mod action;
mod desk;
mod entry;
mod error;
mod gallery;
mod guard;
mod moment;
mod page;
mod picture;
mod project;
mod routes;
mod server;
mod snapshot;
mod studio;
mod token;

pub use error::Error;
pub use project::Sources;
pub use server::serve;
pub use studio::Studio;
