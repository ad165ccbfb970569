//! A multi-threaded CPU rasterizer that turns meshes into G-buffers.
