//! What the page can ask for.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::{DefaultBodyLimit, Path, Query, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::http::{HeaderName, StatusCode};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use futures_util::stream::{Stream, unfold};
use nalgebra::{Matrix3, Point3, Vector3};
use serde::Deserialize;
use serde_json::{Value, json};
use texreg_camera::{Camera, View};
use texreg_driver::{Window, outline_picture};
use texreg_lie::{Pose, so3};

use crate::action::Action;
use crate::desk::Choice;
use crate::picture::{jpeg, photo_jpeg, png};
use crate::snapshot::snapshot;
use crate::studio::Studio;

/// The most bytes of a message.
const MESSAGE: usize = 1 << 16;

/// The most pixels along a side of a picture, and in all.
const SIDE: u32 = 8192;
const PIXELS: u32 = 16 << 20;

/// Pixels along the longer side of a photo's first picture: larger photos are sent reduced, and in parts when looked at closely.
const PREVIEW: u32 = 4096;

/// The least time between two messages about changes.
const PACE: Duration = Duration::from_millis(20);

/// The API, for who has passed the guard.
pub(crate) fn routes(studio: Arc<Studio>) -> Router {
    Router::new()
        .route("/api/events", get(events))
        .route("/api/frame", get(frame))
        .route("/api/pick", get(pick))
        .route("/api/register", post(register))
        .route("/api/cancel", post(cancel))
        .route("/api/photo/{number}/act", post(act))
        .route("/api/photo/{number}/preview", get(preview))
        .route("/api/photo/{number}/part", get(part))
        .route("/api/photo/{number}/overlay", get(overlay))
        .route("/api/photo/{number}/ray", get(ray))
        .route("/api/photo/{number}/pixel", get(pixel))
        .layer(DefaultBodyLimit::max(MESSAGE))
        .with_state(studio)
}

/// A request that is refused, in words.
struct Refusal(StatusCode, String);

impl From<String> for Refusal {
    fn from(words: String) -> Self {
        Self(StatusCode::UNPROCESSABLE_ENTITY, words)
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        (self.0, self.1).into_response()
    }
}

type Answer<T> = Result<T, Refusal>;
type Shared = State<Arc<Studio>>;

/// Works off the thread that serves; a panic there is an answer like any other.
async fn apart<T: Send + 'static>(work: impl FnOnce() -> Result<T, String> + Send + 'static) -> Answer<T> {
    match tokio::task::spawn_blocking(work).await {
        Ok(result) => result.map_err(Refusal::from),
        Err(_) => {
            let words = "a mistake of this program; what was saved is safe, go on";
            Err(Refusal(StatusCode::INTERNAL_SERVER_ERROR, words.to_owned()))
        }
    }
}

/// The state, whenever it changes.
async fn events(State(studio): Shared) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let mut revisions = studio.revisions();
    revisions.mark_changed();
    let stream = unfold((studio, revisions, false), |(studio, mut revisions, paced)| async move {
        if paced {
            tokio::time::sleep(PACE).await;
        }
        revisions.changed().await.ok()?;
        let revision = *revisions.borrow_and_update();
        let state = snapshot(&studio, revision).to_string();
        Some((Ok(Event::default().data(state)), (studio, revisions, true)))
    });
    Sse::new(stream).keep_alive(KeepAlive::new().interval(Duration::from_secs(10)))
}

async fn act(State(studio): Shared, Path(number): Path<usize>, Json(action): Json<Action>) -> Answer<Json<Value>> {
    apart(move || {
        studio.photo(number)?;
        let centre = studio.mesh.centre();
        studio.project().change(number, |entry| entry.act(&action, &centre))?;
        studio.tell();
        Ok(Json(json!({})))
    })
    .await
}

/// What to register, and how: by names, the usual where there are none.
#[derive(Deserialize)]
struct Order {
    photos: Vec<usize>,
    metric: Option<String>,
    solver: Option<String>,
    #[serde(default)]
    signals: Vec<String>,
}

impl Order {
    fn choice(&self) -> Result<Choice, String> {
        let metric = self.metric.as_deref().map(str::parse).transpose()?.unwrap_or_default();
        let solver = self.solver.as_deref().map(str::parse).transpose()?.unwrap_or_default();
        let signals = self.signals.iter().map(|name| name.parse()).collect::<Result<_, _>>()?;
        Ok(Choice { metric, solver, signals })
    }
}

async fn register(State(studio): Shared, Json(order): Json<Order>) -> Answer<Json<Value>> {
    let choice = order.choice()?;
    {
        let project = studio.project();
        for &photo in &order.photos {
            let entry = project.entries.get(photo).ok_or_else(|| "there is no such photo".to_owned())?;
            if entry.now.camera.is_none() {
                return Err(format!("{}: pick four pairs first", entry.file).into());
            }
        }
    }
    studio.desk.put(&order.photos, &choice);
    studio.tell();
    Ok(Json(json!({})))
}

async fn cancel(State(studio): Shared) -> Json<Value> {
    studio.desk.cancel();
    studio.tell();
    Json(json!({}))
}

/// A view of the model as a query names it: rotation by rows, translation, focal length in pixels, size, and the principal point
/// where it is not the middle.
#[derive(Clone, Deserialize)]
struct Seen {
    r: String,
    t: String,
    f: f64,
    w: u32,
    h: u32,
    cx: Option<f64>,
    cy: Option<f64>,
}

impl Seen {
    fn view(&self) -> Result<View, String> {
        let rotation = Matrix3::from_row_slice(&numbers::<9>(&self.r)?);
        let translation = Vector3::from(numbers::<3>(&self.t)?);
        let rotation = so3::nearest(&rotation).ok_or("r is no rotation")?;
        bounded(self.w, self.h)?;
        if !(self.f > 0.0 && self.f < 1e9) {
            return Err("f must be above zero".to_owned());
        }
        let mut camera = Camera::ideal(self.w, self.h, self.f);
        camera.intrinsics.cx = self.cx.filter(|x| x.is_finite()).unwrap_or(camera.intrinsics.cx);
        camera.intrinsics.cy = self.cy.filter(|y| y.is_finite()).unwrap_or(camera.intrinsics.cy);
        Ok(View { camera, pose: Pose::new(rotation, translation) })
    }
}

/// `N` finite numbers with commas between them.
fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let numbers: Vec<f64> = text.split(',').map_while(|n| n.parse().ok()).filter(|x: &f64| x.is_finite()).collect();
    numbers.try_into().map_err(|_| format!("not {N} numbers: {}", text.chars().take(80).collect::<String>()))
}

fn bounded(width: u32, height: u32) -> Result<(), String> {
    let good = (1..=SIDE).contains(&width) && (1..=SIDE).contains(&height) && width * height <= PIXELS;
    if good { Ok(()) } else { Err("the picture is too large".to_owned()) }
}

#[derive(Deserialize)]
struct Frame {
    shading: String,
    /// The photo whose pairs are looked for, and that a textured model wears.
    photo: Option<usize>,
    /// The background, red, green and blue.
    back: String,
    quality: Option<u8>,
}

/// The model as somebody turns it, and which of the photo's pairs are in sight.
async fn frame(State(studio): Shared, Query(seen): Query<Seen>, Query(frame): Query<Frame>) -> Answer<Response> {
    apart(move || {
        let view = seen.view()?;
        let skin = studio.skin(frame.shading.parse()?, frame.photo)?;
        let [r, g, b] = numbers::<3>(&frame.back)?.map(|c| c.clamp(0.0, 255.0) as u8);
        let pairs = frame.photo.and_then(|photo| Some(studio.project().entries.get(photo)?.now.correspondences()));
        let quality = frame.quality.unwrap_or(85).clamp(30, 98);
        let (picture, visible) = studio.draw(|viewer| {
            let pixels = viewer.draw(&studio.mesh, &view, &skin, [r, g, b, 255]);
            let picture = jpeg(pixels, [seen.w, seen.h], quality);
            let shown = |visible| if visible { '1' } else { '0' };
            let pairs = pairs.unwrap_or_default();
            let visible = pairs.iter().map(|pair| shown(viewer.shows(&studio.mesh, &view, &pair.point)));
            (picture, visible.collect::<String>())
        });
        let visible = [(HeaderName::from_static("x-visible"), visible)];
        Ok((visible, sent("image/jpeg", picture?)).into_response())
    })
    .await
}

#[derive(Deserialize)]
struct Pixel {
    x: f64,
    y: f64,
}

/// The point of the model under a pixel of a frame.
async fn pick(State(studio): Shared, Query(seen): Query<Seen>, Query(at): Query<Pixel>) -> Answer<Json<Value>> {
    apart(move || {
        let point = studio.pick(&seen.view()?, [at.x, at.y]);
        Ok(Json(json!({"xyz": point.map(<[f64; 3]>::from)})))
    })
    .await
}

/// The point of the model that the photo's camera sees at a pixel.
async fn ray(State(studio): Shared, Path(number): Path<usize>, Query(at): Query<Pixel>) -> Answer<Json<Value>> {
    apart(move || {
        let point = studio.pick(&studio.view(number, false)?, [at.x, at.y]);
        Ok(Json(json!({"xyz": point.map(<[f64; 3]>::from)})))
    })
    .await
}

#[derive(Deserialize)]
struct Place {
    x: f64,
    y: f64,
    z: f64,
}

/// The pixel at which the photo's camera sees a point, distortion and all.
async fn pixel(State(studio): Shared, Path(number): Path<usize>, Query(at): Query<Place>) -> Answer<Json<Value>> {
    let pixel = studio.view(number, false)?.project(&Point3::new(at.x, at.y, at.z));
    Ok(Json(json!({"uv": pixel.map(<[f64; 2]>::from)})))
}

/// The photo, reduced if it is very large.
async fn preview(State(studio): Shared, Path(number): Path<usize>) -> Answer<Response> {
    apart(move || {
        let photo = studio.photo(number)?;
        let step = photo.width.max(photo.height).div_ceil(PREVIEW);
        let size = [photo.width.div_ceil(step), photo.height.div_ceil(step)];
        let picture = if step == 1 {
            photo_jpeg(&photo.rgb, size, 93)?
        } else {
            let rows = (0..photo.height).step_by(step as usize);
            let row = |y: u32| photo.rgb.iter().skip((y * photo.width) as usize).take(photo.width as usize);
            let pixels: Vec<[u8; 3]> = rows.flat_map(|y| row(y).step_by(step as usize)).copied().collect();
            photo_jpeg(&pixels, size, 93)?
        };
        Ok(sent("image/jpeg", picture))
    })
    .await
}

#[derive(Deserialize)]
struct Part {
    left: u32,
    top: u32,
    width: u32,
    height: u32,
}

/// A part of the photo, pixel by pixel.
async fn part(State(studio): Shared, Path(number): Path<usize>, Query(part): Query<Part>) -> Answer<Response> {
    apart(move || {
        let photo = studio.photo(number)?;
        bounded(part.width, part.height)?;
        let inside = |from: u32, size: u32, all: u32| from.checked_add(size).is_some_and(|end| end <= all);
        if !inside(part.left, part.width, photo.width) || !inside(part.top, part.height, photo.height) {
            return Err("the part is not within the photo".to_owned());
        }
        let rows = photo.rgb.chunks_exact(photo.width as usize).skip(part.top as usize).take(part.height as usize);
        let pixels: Vec<[u8; 3]> =
            rows.flat_map(|row| &row[part.left as usize..][..part.width as usize]).copied().collect();
        Ok(sent("image/jpeg", photo_jpeg(&pixels, [part.width, part.height], 96)?))
    })
    .await
}

#[derive(Deserialize)]
struct Overlay {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
    w: u32,
    h: u32,
    /// A shading, or `outline`.
    kind: String,
    /// The outline's colour, red, green and blue.
    colour: String,
    /// Whether to show where the registration at work is.
    at_work: bool,
}

/// The model over a part of the photo.
async fn overlay(State(studio): Shared, Path(number): Path<usize>, Query(over): Query<Overlay>) -> Answer<Response> {
    apart(move || {
        bounded(over.w, over.h)?;
        let Overlay { left, top, width, height, w, h, .. } = over;
        let sane = |x: f64| x.is_finite() && x.abs() < 1e7;
        if ![left, top, width, height].into_iter().all(sane) || width <= 0.0 || height <= 0.0 {
            return Err("the part of the photo is none".to_owned());
        }
        let window = Window { left, top, width, height, pixels: [w, h] };
        let mut view = studio.view(number, over.at_work)?;
        view.camera = window.camera(&view.camera);
        let picture = if over.kind == "outline" {
            let colour = numbers::<3>(&over.colour)?.map(|c| c.clamp(0.0, 255.0) as u8);
            png(&outline_picture(&studio.mesh, &view, colour), [w, h])?
        } else {
            let skin = studio.skin(over.kind.parse()?, Some(number))?;
            studio.draw(|viewer| png(viewer.draw(&studio.mesh, &view, &skin, [0; 4]), [w, h]))?
        };
        Ok(sent("image/png", picture))
    })
    .await
}

fn sent(kind: &'static str, bytes: Vec<u8>) -> Response {
    ([(CONTENT_TYPE, kind), (CACHE_CONTROL, "no-store")], bytes).into_response()
}
