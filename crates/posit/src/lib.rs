//! Camera poses from 2D–3D correspondences: POSIT, minimal and robust solvers, refinement with covariance.
