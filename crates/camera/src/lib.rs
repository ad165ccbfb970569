//! Pinhole cameras with Brown–Conrady distortion: projection with analytic Jacobians, and the 3×4 projection matrix.
