#![doc = include_str!("../README.md")]

mod agreement;
mod atlas;
mod bands;
mod blend;
mod chart;
mod consensus;
mod draw;
mod error;
mod files;
mod glb;
mod inpaint;
mod pack;
mod sight;
mod split;
mod texture;

pub use agreement::{Agreement, agreement};
pub use bands::Pixels;
pub use blend::Blend;
pub use draw::draw;
pub use error::Error;
pub use files::{mtl, obj, ply, png};
pub use glb::Glb;
pub use texture::{Options, Source, Texture, Textured, Unseen, texture};
