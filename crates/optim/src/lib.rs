//! Maximization on manifolds, for parameters such as camera poses that are no vector space.
//!
//! A [`Manifold`] says how a step in its tangent space moves a point, an [`Objective`] gives value, gradient and
//! curvature with respect to such a step at zero, a [`Solver`] climbs, and a [`Report`] says where it came to, why it
//! stopped and what every iteration did.
//!
//! ```
//! use nalgebra::{DMatrix, DVector};
//! use texreg_optim::{Curvature, Derivatives, Euclidean, LevenbergMarquardt, Objective, Solver};
//!
//! /// −‖x − (1, 2)‖²
//! struct Bowl;
//! impl Objective<DVector<f64>> for Bowl {
//!     fn value(&mut self, at: &DVector<f64>) -> Option<f64> {
//!         Some(-(at - DVector::from_vec(vec![1.0, 2.0])).norm_squared())
//!     }
//!     fn derivatives(&mut self, at: &DVector<f64>) -> Derivatives {
//!         let gradient = -2.0 * (at - DVector::from_vec(vec![1.0, 2.0]));
//!         Derivatives { gradient, curvature: Curvature::Dense(DMatrix::identity(2, 2) * 2.0) }
//!     }
//! }
//! let start = DVector::from_vec(vec![5.0, -3.0]);
//! let report = LevenbergMarquardt::default().maximize(&Euclidean(2), &mut Bowl, start, &mut |_| ()).unwrap();
//! assert!((report.point - DVector::from_vec(vec![1.0, 2.0])).norm() < 1e-6);
//! ```

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod arrow;
mod ascent;
mod block_cholesky;
mod bounded_step;
mod check;
mod curvature;
mod derivative_free;
mod least_squares;
mod levenberg_marquardt;
mod line_search;
mod loss;
mod manifold;
mod objective;
mod region;
mod solver;
mod stochastic;

pub use arrow::{Arm, Arrow, ArrowInverse, Pair};
pub use ascent::{Ascent, Direction};
pub use check::gradient_discrepancy;
pub use curvature::Curvature;
pub use derivative_free::{Bobyqa, NelderMead};
pub use least_squares::{Accumulator, LeastSquares, MinusCost, covariance};
pub use levenberg_marquardt::LevenbergMarquardt;
pub use line_search::LineSearch;
pub use loss::Loss;
pub use manifold::{Charted, Euclidean, Manifold, Power};
pub use objective::{Derivatives, Objective};
pub use region::Region;
pub use solver::{Iteration, Report, Solver, Stop};
pub use stochastic::StochasticGradient;
