//! The command line of texreg.
fn main() {}
