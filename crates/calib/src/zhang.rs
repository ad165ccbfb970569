//! First guesses without distortion: K from homographies, and a board's pose from K and its homography.
//!
//! Z. Zhang, *A flexible new technique for camera calibration*, PAMI 22(11), 2000, sections 3.1 and 3.2, with the skew
//! held at zero. With `H = (h₁ h₂ h₃) = λ K (r₁ r₂ t)` and `B = K⁻ᵀ K⁻¹`, that r₁ and r₂ are of one length and at a right
//! angle says `h₁ᵀ B h₂ = 0` and `h₁ᵀ B h₁ = h₂ᵀ B h₂`: two linear equations in B's entries a board.

use nalgebra::{Matrix3, SMatrix, SVector, SymmetricEigen, Vector3};
use texreg_camera::{Camera, Distortion, Intrinsics};
use texreg_lie::{Pose, so3};

/// Cameras that might have taken homographies, the closed form first if it makes sense, then guesses with the principal
/// point in the image's centre. Size in pixels.
pub(crate) fn guesses(homographies: &[Matrix3<f64>], [width, height]: [u32; 2]) -> Vec<Camera> {
    let middle = |n: u32| 0.5 * (f64::from(n) - 1.0);
    let center = (middle(width), middle(height));
    let size = f64::from(width.max(height));
    // Pixels relative to the centre, in units of the image's size, keep the equations well scaled.
    let normalize = Matrix3::new(1.0 / size, 0.0, -center.0 / size, 0.0, 1.0 / size, -center.1 / size, 0.0, 0.0, 1.0);
    let scaled: Vec<Matrix3<f64>> = homographies
        .iter()
        .map(|h| {
            let h = normalize * h;
            h / h.fixed_columns::<2>(0).norm()
        })
        .collect();
    let sensible = |k: &Intrinsics| {
        let focal = 0.2..20.0;
        focal.contains(&k.fx) && focal.contains(&k.fy) && k.cx.abs() < 0.5 && k.cy.abs() < 0.5
    };
    let closed = closed_form(&scaled).filter(sensible);
    let centered = centered(&scaled).filter(sensible);
    // Boards that face the camera say nothing of the focal length: any may do.
    let plain = [0.6, 1.0, 2.0].map(|focal| Intrinsics::new(focal, 0.0, 0.0));
    let guesses = closed.into_iter().chain(centered).chain(plain);
    let camera = |k: Intrinsics| Camera {
        width,
        height,
        intrinsics: Intrinsics {
            fx: k.fx * size,
            fy: k.fy * size,
            cx: k.cx * size + center.0,
            cy: k.cy * size + center.1,
            skew: 0.0,
        },
        distortion: Distortion::default(),
    };
    guesses.map(camera).collect()
}

/// `vᵢⱼ` with `vᵢⱼᵀ b = hᵢᵀ B hⱼ` for `b = (B₁₁, B₂₂, B₁₃, B₂₃, B₃₃)`, B₁₂ being zero without skew.
fn products(a: &Vector3<f64>, b: &Vector3<f64>) -> SVector<f64, 5> {
    SVector::from([a.x * b.x, a.y * b.y, a.z * b.x + a.x * b.z, a.z * b.y + a.y * b.z, a.z * b.z])
}

/// Zhang's closed form; `None` if B is not that of a camera.
fn closed_form(homographies: &[Matrix3<f64>]) -> Option<Intrinsics> {
    let mut normal = SMatrix::<f64, 5, 5>::zeros();
    for h in homographies {
        let (a, b) = (h.column(0).into_owned(), h.column(1).into_owned());
        for row in [products(&a, &b), products(&a, &a) - products(&b, &b)] {
            normal += row * row.transpose();
        }
    }
    let eigen = SymmetricEigen::new(normal);
    let b = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let [b11, b22, b13, b23, b33] = [b[0], b[1], b[2], b[3], b[4]];
    let (cx, cy) = (-b13 / b11, -b23 / b22);
    let lambda = b33 - b13 * b13 / b11 - b23 * b23 / b22;
    let (fx2, fy2) = (lambda / b11, lambda / b22);
    (fx2 > 0.0 && fy2 > 0.0).then(|| Intrinsics { fx: fx2.sqrt(), fy: fy2.sqrt(), cx, cy, skew: 0.0 })
}

/// The focal length alone, by least squares on the same equations.
fn centered(homographies: &[Matrix3<f64>]) -> Option<Intrinsics> {
    let (mut numerator, mut denominator) = (0.0, 0.0);
    for h in homographies {
        let (a, b) = (h.column(0), h.column(1));
        // (x x' + y y') / f² + z z' = 0
        let equations = [
            (a.x * b.x + a.y * b.y, a.z * b.z),
            (a.x * a.x + a.y * a.y - b.x * b.x - b.y * b.y, a.z * a.z - b.z * b.z),
        ];
        for (plane, depth) in equations {
            numerator -= plane * depth;
            denominator += depth * depth;
        }
    }
    let square = numerator / denominator;
    (square > 0.0 && square.is_finite()).then(|| Intrinsics::new(square.sqrt(), 0.0, 0.0))
}

/// The pose of a board with this homography (from the board's plane to pixels), in front of the camera.
pub(crate) fn pose(camera: &Camera, homography: &Matrix3<f64>) -> Option<Pose> {
    let m = camera.intrinsics.matrix().try_inverse()? * homography;
    let scale = 2.0 / (m.column(0).norm() + m.column(1).norm());
    let m = m * if m[(2, 2)] < 0.0 { -scale } else { scale };
    let (r1, r2) = (m.column(0).into_owned(), m.column(1).into_owned());
    let rotation = so3::nearest(&Matrix3::from_columns(&[r1, r2, r1.cross(&r2)]))?;
    let pose = Pose::new(rotation, m.column(2).into_owned());
    pose.is_finite().then_some(pose)
}
