//! The HTML report of a calibration: one file that stands alone, pictures, plots and style inside, no scripts.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use texreg::calib::{Calibration, Coverage};
use texreg::camera::Camera;

use crate::calibrate::{Entry, Result, parameters};
use crate::report::{escape, significant};

/// The whole page.
pub(crate) fn html(command: &str, result: &Result<'_>) -> String {
    let Calibration { camera, model, rms, sigma, .. } = result.calibration;
    let used = result.entries.iter().filter(|entry| entry.verdict() == "used").count();
    let title = match result.entries.len() {
        all if all == used => format!("Camera calibrated from {all} photos"),
        all => format!("Camera calibrated from {used} of {all} photos"),
    };
    let board = &result.board;
    let k = &camera.intrinsics;
    let fact = |name: &str, value: &str| format!("<div><h3>{name}</h3><div class=\"value\">{value}</div></div>\n");
    let wide = 2.0 * (0.5 * f64::from(camera.width) / k.fx).atan().to_degrees();
    let tall = 2.0 * (0.5 * f64::from(camera.height) / k.fy).atan().to_degrees();
    let facts = fact("Reprojection error, RMS", &format!("{rms:.3} px"))
        + &fact("A corner's coordinate", &format!("± {sigma:.3} px"))
        + &fact("Focal length", &format!("{:.2} × {:.2} px", k.fx, k.fy))
        + &fact("Field of view", &format!("{wide:.1}° × {tall:.1}°"))
        + &fact("Lens model", model.name());
    let version = env!("CARGO_PKG_VERSION");
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{title}</title>\n\
         <style>\n{css}{own}</style>\n</head>\n<body>\n<main>\n<h1>{title}</h1>\n\
         <p class=\"soft\">{width} × {height} pixels, a board of {columns} × {rows} inner corners, squares of {square}</p>\n\
         <p><code>{command}</code></p>\n\
         <section class=\"card\">\n<div class=\"facts\">\n{facts}</div>\n{weak}<div class=\"pair\">\n{values}{trials}</div>\n\
         </section>\n\
         <section class=\"card\">\n<div class=\"plots\">\n{coverage}{scatter}{arrows}{distortion}</div>\n</section>\n\
         {photos}{pictures}<footer>Written by texreg {version}.</footer>\n</main>\n</body>\n</html>\n",
        css = include_str!("report.css"),
        own = STYLE,
        width = camera.width,
        height = camera.height,
        columns = board.columns,
        rows = board.rows,
        square = significant(board.square),
        command = escape(command),
        weak = weak(result),
        values = values(result.calibration),
        trials = trials(result.calibration),
        coverage = coverage(result),
        scatter = scatter(result),
        arrows = arrows(result),
        distortion = distortion(camera),
        photos = photos(result),
        pictures = pictures(&result.entries),
    )
}

/// What this page needs beside the style of all reports.
const STYLE: &str = "svg { display: block; width: 100%; height: auto; }\n\
    svg text { fill: var(--soft); font: 11px system-ui, sans-serif; }\n\
    .frame { fill: none; stroke: var(--line); }\n.axis { stroke: var(--line); }\n.mark { stroke: var(--soft); fill: none; }\n\
    .dot { fill: var(--good); fill-opacity: 0.55; }\n.stick { stroke: var(--doubt); stroke-width: 1.2; }\n\
    .few { fill: var(--doubt-back); }\n.bar { fill: var(--good); }\n.bar.out { fill: var(--bad); }\n\
    .curve { fill: none; stroke: var(--good); stroke-width: 2; }\nfigure { margin: 0; }\n\
    figcaption { font-size: 13px; color: var(--soft); margin-top: 6px; }\n\
    .plots { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(420px, 100%), 1fr)); gap: 28px 40px; }\n\
    .gallery { display: grid; grid-template-columns: repeat(auto-fill, minmax(260px, 1fr)); gap: 16px; }\n\
    .gallery img { width: 100%; border-radius: 6px; display: block; }\n";

fn weak(result: &Result<'_>) -> String {
    if result.weaknesses.is_empty() {
        return "<p class=\"soft\">The photos leave nothing poorly determined.</p>\n".into();
    }
    let items: String = result.weaknesses.iter().map(|w| format!("<li>{}</li>", escape(&w.to_string()))).collect();
    format!("<h3>What is poorly determined</h3>\n<ul>{items}</ul>\n")
}

fn values(calibration: &Calibration) -> String {
    let mut html = String::from(
        "<div class=\"scroll\">\n<h3>Parameters</h3>\n<table>\n<tr><th></th><th class=\"right\">value</th>\
         <th class=\"right\">standard deviation</th></tr>\n",
    );
    for [name, value, deviation] in parameters(calibration) {
        let _ = writeln!(
            html,
            "<tr><th>{name}</th><td class=\"right\">{value}</td><td class=\"right\">± {deviation}</td></tr>"
        );
    }
    html + "</table>\n</div>\n"
}

fn trials(calibration: &Calibration) -> String {
    let mut html = String::from(
        "<div class=\"scroll\">\n<h3>Lens models tried</h3>\n<table>\n<tr><th>model</th><th class=\"right\">rms px</th>\
         <th class=\"right\">BIC</th></tr>\n",
    );
    for trial in &calibration.trials {
        let name = trial.model.name();
        let name = if trial.model == calibration.model { format!("<b>{name}</b>") } else { name.to_owned() };
        let _ = writeln!(
            html,
            "<tr><td>{name}</td><td class=\"right\">{:.4}</td><td class=\"right\">{:.1}</td></tr>",
            trial.rms, trial.bic
        );
    }
    html + "</table>\n<p class=\"soft\">Of several, the simplest within 10 of the least BIC is taken.</p>\n</div>\n"
}

/// A drawing of the image's area, `WIDE` units across, with a caption.
fn figure(camera: &Camera, name: &str, caption: &str, inside: &str) -> String {
    let height = WIDE * f64::from(camera.height) / f64::from(camera.width);
    format!(
        "<figure>\n<h3>{name}</h3>\n<svg viewBox=\"-1 -1 {} {:.1}\" role=\"img\" aria-label=\"{name}\">\n{inside}\
         <rect class=\"frame\" width=\"{WIDE}\" height=\"{height:.1}\"/>\n</svg>\n<figcaption>{caption}</figcaption>\n</figure>\n",
        WIDE + 2.0,
        height + 2.0,
    )
}

/// Units across a drawing.
const WIDE: f64 = 480.0;

/// Where the used photos' corners lie in the image, and how many photos show each ninth of it.
fn coverage(result: &Result<'_>) -> String {
    let camera = &result.calibration.camera;
    let scale = WIDE / f64::from(camera.width);
    let fits = result.calibration.photos.iter().zip(result.corners);
    let used = fits.filter(|(fit, _)| !fit.is_outlier).map(|(_, corners)| corners.as_slice());
    let used: Vec<_> = used.collect();
    let counts = Coverage::new([camera.width, camera.height], used.iter().copied()).photos;
    let (cell_width, cell_height) = (WIDE / 3.0, scale * f64::from(camera.height) / 3.0);
    let mut inside = String::new();
    for (row, counts) in counts.iter().enumerate() {
        for (column, count) in counts.iter().enumerate() {
            let (x, y) = (column as f64 * cell_width, row as f64 * cell_height);
            let class = if *count < 3 { "frame few" } else { "frame" };
            let _ = writeln!(
                inside,
                "<rect class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{cell_width:.1}\" height=\"{cell_height:.1}\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\">{count} photo{}</text>",
                x + 6.0,
                y + 15.0,
                if *count == 1 { "" } else { "s" }
            );
        }
    }
    for corner in used.into_iter().flatten() {
        let (x, y) = (scale * (corner.pixel.x + 0.5), scale * (corner.pixel.y + 0.5));
        let _ = writeln!(inside, "<circle class=\"dot\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"1.8\"/>");
    }
    figure(
        camera,
        "Coverage of the image",
        "Every corner used, and the photos that show the board in each ninth.",
        &inside,
    )
}

/// The residuals as points around zero.
fn scatter(result: &Result<'_>) -> String {
    let calibration = result.calibration;
    let reach = 4.0 * calibration.sigma.max(1e-6);
    let (middle, unit) = (150.0, 140.0 / reach);
    let mut inside = format!(
        "<line class=\"axis\" x1=\"10\" x2=\"290\" y1=\"{middle}\" y2=\"{middle}\"/>\n\
         <line class=\"axis\" x1=\"{middle}\" x2=\"{middle}\" y1=\"10\" y2=\"290\"/>\n"
    );
    let residuals = calibration.photos.iter().filter(|photo| !photo.is_outlier).flat_map(|photo| &photo.residuals);
    for r in residuals {
        let place = |v: f64| middle + unit * v.clamp(-reach, reach);
        let _ = writeln!(inside, "<circle class=\"dot\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"1.6\"/>", place(r.x), place(r.y));
    }
    for times in [1.0, 2.0, 3.0] {
        let radius = times * calibration.sigma * unit;
        let _ = writeln!(
            inside,
            "<circle class=\"mark\" cx=\"{middle}\" cy=\"{middle}\" r=\"{radius:.1}\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\">{times}σ</text>",
            middle + 0.72 * radius,
            middle - 0.72 * radius - 2.0
        );
    }
    format!(
        "<figure>\n<h3>Residuals</h3>\n<svg viewBox=\"0 0 300 300\" style=\"max-width: 360px\" role=\"img\" \
         aria-label=\"Residuals\">\n{inside}</svg>\n<figcaption>Seen minus predicted, every corner; σ is {:.3} px. Points \
         beyond 4σ are drawn on the rim.</figcaption>\n</figure>\n",
        calibration.sigma
    )
}

/// The residuals where they are in the image: a pattern tells of a lens model that is too simple.
fn arrows(result: &Result<'_>) -> String {
    let calibration = result.calibration;
    let camera = &calibration.camera;
    let scale = WIDE / f64::from(camera.width);
    // A residual of σ is 8 units long.
    let stretch = 8.0 / calibration.sigma.max(1e-9);
    let mut inside = String::new();
    let used = calibration.photos.iter().zip(result.corners).filter(|(fit, _)| !fit.is_outlier);
    for (fit, corners) in used {
        for (corner, r) in corners.iter().zip(&fit.residuals) {
            let (x, y) = (scale * (corner.pixel.x + 0.5), scale * (corner.pixel.y + 0.5));
            let (x2, y2) = (x + stretch * r.x, y + stretch * r.y);
            let _ =
                writeln!(inside, "<line class=\"stick\" x1=\"{x:.1}\" y1=\"{y:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"/>");
        }
    }
    let caption = format!(
        "Each corner's residual, {:.0} times enlarged. Sticks that point one way in a part of the image are the lens \
         model's fault.",
        stretch / scale
    );
    figure(camera, "Residuals in the image", &caption, &inside)
}

/// How far the lens moves a point, along the way from the principal point to the farthest corner.
fn distortion(camera: &Camera) -> String {
    let k = &camera.intrinsics;
    let (width, height) = (f64::from(camera.width) - 0.5, f64::from(camera.height) - 0.5);
    let corners = [(-0.5, -0.5), (width, -0.5), (-0.5, height), (width, height)];
    let far = corners.map(|(x, y)| nalgebra::Point2::new(x, y));
    let center = nalgebra::Point2::new(k.cx, k.cy);
    let Some(far) = far.into_iter().max_by(|a, b| (a - center).norm().total_cmp(&(b - center).norm())) else {
        return String::new();
    };
    let reach = (far - center).norm();
    let shifts: Vec<(f64, f64)> = (0..=40)
        .filter_map(|i| {
            let share = f64::from(i) / 40.0;
            let pixel = center + (far - center) * share;
            let straight = camera.undistort(&pixel)?;
            Some((share, (pixel - center).norm() - (straight - center).norm()))
        })
        .collect();
    let most = shifts.iter().map(|(_, shift)| shift.abs()).fold(1e-9, f64::max);
    let points: Vec<String> = shifts
        .iter()
        .map(|(share, shift)| format!("{:.1},{:.1}", 40.0 + 420.0 * share, 110.0 - 90.0 * shift / most))
        .collect();
    format!(
        "<figure>\n<h3>Distortion</h3>\n<svg viewBox=\"0 0 480 220\" role=\"img\" aria-label=\"Distortion\">\n\
         <line class=\"axis\" x1=\"40\" x2=\"460\" y1=\"110\" y2=\"110\"/>\n\
         <line class=\"axis\" x1=\"40\" x2=\"40\" y1=\"20\" y2=\"200\"/>\n<polyline class=\"curve\" points=\"{}\"/>\n\
         <text x=\"2\" y=\"24\">{most:+.1}</text><text x=\"2\" y=\"204\">{:+.1}</text><text x=\"395\" y=\"126\">{reach:.0} px out</text>\n\
         </svg>\n<figcaption>Pixels by which the lens moves a point outwards, from the principal point to the farthest \
         corner of the image.</figcaption>\n</figure>\n",
        points.join(" "),
        -most
    )
}

fn photos(result: &Result<'_>) -> String {
    let mut html = String::from(
        "<section class=\"card scroll\">\n<table>\n<tr><th>photo</th><th></th><th class=\"right\">corners</th>\
         <th class=\"right\">rms px</th><th></th><th class=\"right\">worst px</th><th class=\"right\">tilted</th>\
         <th class=\"right\">away</th></tr>\n",
    );
    let errors = result.calibration.photos.iter().map(|photo| photo.rms).filter(|rms| rms.is_finite());
    let largest = errors.fold(1e-9, f64::max);
    for entry in &result.entries {
        let class = if entry.verdict() == "used" { "registered" } else { "uncertain" };
        let _ = write!(
            html,
            "<tr><td>{}</td><td><span class=\"verdict {class}\">{}</span></td>",
            escape(&entry.looked.file),
            entry.verdict()
        );
        let Some(fit) = entry.fit else {
            html += "<td></td><td></td><td></td><td></td><td></td><td></td></tr>\n";
            continue;
        };
        let worst = fit.residuals.iter().map(|r| r.norm()).fold(0.0, f64::max);
        let out = if fit.is_outlier { " out" } else { "" };
        let _ = writeln!(
            html,
            "<td class=\"right\">{}</td><td class=\"right\">{:.3}</td>\
             <td><svg viewBox=\"0 0 100 12\" style=\"width: 120px\" aria-hidden=\"true\">\
             <rect class=\"bar{out}\" y=\"2\" width=\"{:.1}\" height=\"9\"/></svg></td>\
             <td class=\"right\">{worst:.3}</td><td class=\"right\">{:.1}°</td><td class=\"right\">{}</td></tr>",
            fit.residuals.len(),
            fit.rms,
            100.0 * (fit.rms / largest).min(1.0),
            fit.tilt().to_degrees(),
            significant(fit.pose.center().coords.norm()),
        );
    }
    html + "</table>\n</section>\n"
}

fn pictures(entries: &[Entry<'_>]) -> String {
    let figure = |entry: &Entry<'_>| {
        let file = escape(&entry.looked.file);
        format!(
            "<figure><img alt=\"{file} with its corners\" src=\"data:image/jpeg;base64,{}\"><figcaption>{file}</figcaption></figure>\n",
            BASE64_STANDARD.encode(&entry.looked.thumbnail)
        )
    };
    let figures: String = entries.iter().map(figure).collect();
    format!("<section class=\"card\">\n<div class=\"gallery\">\n{figures}</div>\n</section>\n")
}
