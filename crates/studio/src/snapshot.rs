//! What a page is told of the project: all of it, as JSON.

use serde_json::{Value, json};
use texreg_camera::Camera;
use texreg_driver::{MetricName, Shading, SolverName};
use texreg_surface::SignalName;

use crate::desk::Running;
use crate::entry::{Entry, Optics};
use crate::moment::{Half, word};
use crate::studio::Studio;

/// The whole state.
pub(crate) fn snapshot(studio: &Studio, revision: u64) -> Value {
    let (running, queue) = studio.desk.state();
    let (notice, words) = studio.last_notice();
    let mesh = &studio.mesh;
    let photos: Vec<Value> = studio.project().entries.iter().map(photo).collect();
    json!({
        "revision": revision,
        "model": {
            "file": studio.name,
            "triangles": mesh.triangles.len(),
            "centre": <[f64; 3]>::from(mesh.centre()),
            "diagonal": mesh.diagonal(),
            "shadings": names(Shading::of(mesh).iter()),
        },
        "choices": {
            "metric": names(MetricName::ALL.iter()),
            "solver": names(SolverName::ALL.iter()),
            "signals": names(SignalName::ALL.iter().filter(|name| name.is_in(mesh))),
        },
        "photos": photos,
        "job": running.as_ref().map(job),
        "queue": queue,
        "notice": {"id": notice, "text": words},
    })
}

fn names(all: impl Iterator<Item = impl ToString>) -> Vec<String> {
    all.map(|name| name.to_string()).collect()
}

fn job(running: &Running) -> Value {
    let stages: Vec<Value> = running
        .stages
        .iter()
        .map(|stage| json!({"name": stage.name, "start": stage.similarity.0, "end": stage.similarity.1}))
        .collect();
    json!({"photo": running.photo, "done": running.done, "of": running.of, "stages": stages})
}

fn photo(entry: &Entry) -> Value {
    let now = &entry.now;
    let pairs: Vec<Value> = now
        .pairs
        .iter()
        .enumerate()
        .map(|(i, pair)| {
            let fit = entry.fits.get(i);
            json!({
                "id": pair.id,
                "name": pair.name,
                "xyz": <[f64; 3]>::from(pair.ends.point),
                "uv": <[f64; 2]>::from(pair.ends.pixel),
                "predicted": fit.and_then(|fit| fit.predicted).map(<[f64; 2]>::from),
                "residual": fit.map(|fit| fit.residual).filter(|residual| residual.is_finite()),
                "left_out": entry.left_out.contains(&i),
                "suspicious": fit.is_some_and(|fit| fit.suspicious),
            })
        })
        .collect();
    let camera = now.camera.as_ref().map(|placed| {
        let rows: [[f64; 3]; 3] = placed.view.pose.rotation.matrix().transpose().into();
        let verdict = placed.verdict.as_ref().map(|verdict| {
            let (start, end) = verdict.similarity;
            let (reasons, sure) = (&verdict.reasons, &verdict.uncertainty["pixels"]);
            json!({"status": word(verdict.status), "reasons": reasons, "start": start, "end": end, "sure": sure})
        });
        json!({
            "source": placed.source,
            "accepted": placed.accepted,
            "verdict": verdict,
            "R": rows,
            "T": <[f64; 3]>::from(placed.view.pose.translation),
            "K": keys(&placed.view.camera),
        })
    });
    let (undo, redo) = entry.steps();
    json!({
        "file": entry.file,
        "size": entry.size(),
        "optics": match entry.optics {
            Optics::Unread => "unread",
            Optics::File(_) => "file",
            Optics::Exif(_) => "exif",
            Optics::Unknown(_) => "unknown",
        },
        "status": now.status(),
        "pairs": pairs,
        "pending": now.pending.map(|half| match half {
            Half::Photo(pixel) => json!({"uv": <[f64; 2]>::from(pixel)}),
            Half::Model(point) => json!({"xyz": <[f64; 3]>::from(point)}),
        }),
        "camera": camera,
        "trouble": entry.trouble,
        "ambiguous": entry.ambiguous,
        "undo": undo,
        "redo": redo,
    })
}

fn keys(camera: &Camera) -> Value {
    let k = &camera.intrinsics;
    json!({"fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy})
}
