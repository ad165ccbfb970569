//! texreg lays photographs onto scanned 3D models: this crate re-exports the workspace's parts under one name.
pub use texreg_bundle as bundle;
pub use texreg_calib as calib;
pub use texreg_camera as camera;
pub use texreg_driver as driver;
pub use texreg_formats as formats;
pub use texreg_lie as lie;
pub use texreg_mi as mi;
pub use texreg_optim as optim;
pub use texreg_posit as posit;
pub use texreg_raster as raster;
pub use texreg_surface as surface;
pub use texreg_texture as texture;
