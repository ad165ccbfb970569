//! Benchmarks and experiments: `cargo xtask bench NAME`.
fn main() {}
