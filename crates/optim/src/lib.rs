//! Solvers on manifolds: objectives, curvature and trust regions for poses and cameras.
