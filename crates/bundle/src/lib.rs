//! Bundle adjustment: cameras and points jointly, from where the ones saw the others.
//!
//! [`BundleAdjustment`] minimizes the reprojection error of a [`Bundle`] for any camera model that is a
//! [`ReprojectionError`]; [`Columns`] say which parameters are free, shared or fixed. [`Snavely`] is the model of the BAL
//! problems, which [`read_bal`] and [`write_bal`] read and write.
//!
//! ```
//! use texreg_bundle::{BundleAdjustment, Columns, Snavely, read_bal};
//!
//! // Two cameras half a unit apart see two points.
//! let text = "2 2 4  0 0 10 20  1 0 -40 20  0 1 0 5  1 1 -25 4
//!     0 0 0  0 0 0     100 0 0
//!     0 0 0  -0.5 0 0  100 0 0
//!     0.1 0.2 -1.1     0 0.1 -2.1";
//! let bundle = read_bal(text)?;
//! let columns = Columns::own(bundle.cameras.len());
//! let report = BundleAdjustment::default().adjust(&Snavely, bundle, &columns, &mut |_| ()).unwrap();
//! assert!(report.value > report.start && report.value > -1e-6);
//! # Ok::<(), texreg_bundle::BalError>(())
//! ```

mod adjust;
mod bal;
mod columns;
mod reduced;
mod snavely;

pub use adjust::{Bundle, BundleAdjustment, Observation, ReprojectionError};
pub use bal::{BalError, fixed_gauge, read_bal, write_bal};
pub use columns::Columns;
pub use snavely::{INTRINSICS, ROTATION, Snavely, SnavelyCamera, TRANSLATION};
