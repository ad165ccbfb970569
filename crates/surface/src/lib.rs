//! Scanned surfaces: loading, validation and the per-vertex signals a photograph can be compared with.
