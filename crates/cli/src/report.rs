//! The HTML report of a registration: one file that stands alone, images and style inside, no scripts.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use texreg::camera::View;
use texreg::surface::Mesh;

use crate::register::Registered;

/// What the head of the report tells.
pub(crate) struct Head<'a> {
    /// The command as it was typed.
    pub(crate) command: &'a str,
    /// The options that shaped the result, and their values.
    pub(crate) options: &'a [(&'static str, String)],
    /// The model's file.
    pub(crate) model: &'a str,
    /// The model.
    pub(crate) mesh: &'a Mesh,
}

/// The whole page.
pub(crate) fn html(head: &Head<'_>, photos: &[Registered]) -> String {
    let good = photos.iter().filter(|photo| photo.is_good()).count();
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{good} of {count} registered: {model}</title>\n<style>\n{css}</style>\n</head>\n<body>\n<main>\n\
         <h1>{good} of {count} photo{s} registered</h1>\n<p class=\"soft\">{model}, {stats}</p>\n\
         <p><code>{command}</code></p>\n<p class=\"soft\">{options}</p>\n",
        count = photos.len(),
        s = if photos.len() == 1 { "" } else { "s" },
        model = escape(head.model),
        css = include_str!("report.css"),
        stats = escape(&model_stats(head.mesh)),
        command = escape(head.command),
        options = head.options.iter().map(|(name, value)| format!("{name} {value}")).collect::<Vec<_>>().join(", "),
    );
    if photos.len() > 1 {
        page += &summary(photos);
    }
    for (i, photo) in photos.iter().enumerate() {
        page += &card(i, photo);
    }
    let version = env!("CARGO_PKG_VERSION");
    let _ = write!(page, "<footer>Written by texreg {version}.</footer>\n</main>\n</body>\n</html>\n");
    page
}

/// The model in a few words.
pub(crate) fn model_stats(mesh: &Mesh) -> String {
    let mut text = format!(
        "{} vertices, {} triangles, {} units across",
        grouped(mesh.positions.len()),
        grouped(mesh.triangles.len()),
        significant(mesh.diagonal())
    );
    if mesh.reflectance.is_some() {
        text += ", with reflectance";
    }
    if mesh.colours.is_some() {
        text += ", with colours";
    }
    text
}

fn summary(photos: &[Registered]) -> String {
    let mut html = String::from(
        "<section class=\"card scroll\">\n<table>\n<tr><th>photo</th><th>verdict</th><th class=\"right\">similarity</th>\
         <th class=\"right\">rotated</th><th class=\"right\">moved</th></tr>\n",
    );
    for (i, photo) in photos.iter().enumerate() {
        let _ = writeln!(
            html,
            "<tr><td><a href=\"#photo-{i}\">{}</a></td><td><span class=\"verdict {verdict}\">{verdict}</span></td>\
             <td class=\"right\">{}</td><td class=\"right\">{:.2}°</td><td class=\"right\">{:.2} %</td></tr>",
            escape(&photo.file),
            similarity(photo),
            photo.motion.rotation_deg,
            photo.motion.distance_pct,
            verdict = photo.verdict(),
        );
    }
    html + "</table>\n</section>\n"
}

fn card(i: usize, photo: &Registered) -> String {
    let reasons: String = photo.remarks().iter().map(|remark| format!("<li>{}</li>", escape(remark))).collect();
    let reasons = if reasons.is_empty() { reasons } else { format!("<ul>{reasons}</ul>\n") };
    format!(
        "<section class=\"card\" id=\"photo-{i}\">\n<div class=\"title\"><h2>{file}</h2>\
         <span class=\"verdict {verdict}\">{verdict}</span></div>\n{reasons}\
         <img class=\"overlay\" alt=\"The model's outline over {file}, at the start and at the end\" \
         src=\"data:image/jpeg;base64,{picture}\">\n\
         <div class=\"facts\">\n{facts}</div>\n<div class=\"pair\">\n{camera}{stages}</div>\n</section>\n",
        file = escape(&photo.file),
        verdict = photo.verdict(),
        picture = BASE64_STANDARD.encode(&photo.overlay),
        facts = facts(photo),
        camera = camera(&photo.outcome.view),
        stages = stages(photo),
    )
}

fn facts(photo: &Registered) -> String {
    let fact = |name: &str, value: &str| format!("<div><h3>{name}</h3><div class=\"value\">{value}</div></div>\n");
    let focal = |view: &View| view.camera.intrinsics.fx;
    let change = 100.0 * (focal(&photo.outcome.view) / focal(&photo.start) - 1.0);
    let milliseconds: f64 = photo.outcome.stages.iter().map(|stage| stage.milliseconds).sum();
    let mut html = fact("Similarity", &similarity(photo))
        + &fact("Rotated by", &format!("{:.3}°", photo.motion.rotation_deg))
        + &fact("Moved by", &format!("{:.3} % of the model", photo.motion.distance_pct));
    if change != 0.0 {
        html += &fact("Focal length changed by", &format!("{change:+.3} %"));
    }
    if let Some(found) = &photo.outcome.uncertainty {
        html += &fact(
            "Sure to",
            &format!("±{:.2} px, ±{:.3}°, ±{} units", found.pixels, found.rotation_deg, significant(found.centre)),
        );
        html += &fact("Weakest in", &found.weakest);
        if let Some(focal) = found.focal {
            let text = format!("±{:.2} %, correlation with the distance {:.2}", focal.percent, focal.with_distance);
            html += &fact("Focal length sure to", &text);
        }
    }
    html + &fact("Work", &format!("{} evaluations, {milliseconds:.0} ms", grouped(photo.outcome.evaluations())))
}

fn similarity(photo: &Registered) -> String {
    let (start, end) = photo.outcome.similarity;
    format!("{start:.4} → {end:.4}")
}

/// The camera in units a reader knows.
fn camera(view: &View) -> String {
    let (camera, k) = (&view.camera, &view.camera.intrinsics);
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let wide = 2.0 * (0.5 * width / k.fx).atan().to_degrees();
    let tall = 2.0 * (0.5 * height / k.fy).atan().to_degrees();
    let equivalent = k.fx * 36f64.hypot(24.0) / width.hypot(height);
    let focal = if k.fx == k.fy { format!("{:.2} px", k.fx) } else { format!("{:.2} × {:.2} px", k.fx, k.fy) };
    let distortion = if camera.distortion.is_none() {
        "none".to_owned()
    } else {
        let [k1, k2, p1, p2, k3] = camera.distortion.to_array();
        format!("k1 {k1:.5}, k2 {k2:.5}, p1 {p1:.5}, p2 {p2:.5}, k3 {k3:.5}")
    };
    let centre = view.pose.center();
    let axis = view.pose.rotation.inverse() * nalgebra::Vector3::z();
    let rows = [
        ("image", format!("{} × {} px", camera.width, camera.height)),
        ("focal length", format!("{focal}, like {equivalent:.1} mm on 35 mm film")),
        ("field of view", format!("{wide:.1}° × {tall:.1}°")),
        ("principal point", format!("({:.2}, {:.2}) px", k.cx, k.cy)),
        ("distortion", distortion),
        ("centre", format!("({}, {}, {})", significant(centre.x), significant(centre.y), significant(centre.z))),
        ("looks along", format!("({:.4}, {:.4}, {:.4})", axis.x, axis.y, axis.z)),
    ];
    let mut html = String::from("<div class=\"scroll\">\n<h3>Camera</h3>\n<table>\n");
    for (name, value) in rows {
        let _ = writeln!(html, "<tr><th>{name}</th><td>{value}</td></tr>");
    }
    html + "</table>\n</div>\n"
}

fn stages(photo: &Registered) -> String {
    let mut html = String::from(
        "<div class=\"scroll\">\n<h3>Stages</h3>\n<table>\n<tr><th>stage</th><th class=\"right\">evaluations</th>\
         <th class=\"right\">ms</th><th class=\"right\">similarity</th></tr>\n",
    );
    for stage in &photo.outcome.stages {
        let _ = writeln!(
            html,
            "<tr><td>{}</td><td class=\"right\">{}</td><td class=\"right\">{:.0}</td><td class=\"right\">{:.4} → {:.4}</td></tr>",
            escape(&stage.name),
            stage.evaluations,
            stage.milliseconds,
            stage.similarity.0,
            stage.similarity.1
        );
    }
    html + "</table>\n</div>\n"
}

/// A number with its thousands apart.
fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A length with six significant digits, at most six of them behind the point.
pub(crate) fn significant(x: f64) -> String {
    let whole = if x == 0.0 { 1.0 } else { x.abs().log10().floor() + 1.0 };
    let places = (6.0 - whole).clamp(0.0, 6.0) as usize;
    format!("{x:.places$}")
}

/// Text as HTML.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
