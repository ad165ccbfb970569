//! The server: one thread that talks, a few that work.

use std::net::SocketAddr;
use std::sync::Arc;

use axum::http::StatusCode;
use axum::response::IntoResponse as _;
use axum::{Router, middleware};
use tokio::net::TcpListener;
use tower_http::catch_panic::CatchPanicLayer;

use crate::Error;
use crate::guard::{Guard, guard};
use crate::page::page;
use crate::routes::routes;
use crate::studio::Studio;
use crate::token::token;

/// Requests that are worked on at a time.
const WORKERS: usize = 4;

/// Serves a studio's page at an address (port 0 takes a free one) until the program ends. `announce` is given the address to
/// open, with the secret that opens it.
///
/// # Errors
/// If the address is taken or not this machine's.
pub fn serve(studio: &Arc<Studio>, address: SocketAddr, announce: impl FnOnce(&str)) -> Result<(), Error> {
    let system = |error: std::io::Error| Error::System(error.to_string());
    let mut runtime = tokio::runtime::Builder::new_current_thread();
    let runtime = runtime.enable_io().enable_time().max_blocking_threads(WORKERS).build().map_err(system)?;
    let guard = Guard { token: token()?, loopback: address.ip().is_loopback() };
    runtime.block_on(async {
        let listener = TcpListener::bind(address).await.map_err(|source| Error::Address { address, source })?;
        let bound = listener.local_addr().map_err(system)?;
        announce(&format!("http://{bound}/#{}", guard.token));
        axum::serve(listener, app(Arc::clone(studio), guard)).await.map_err(system)
    })
}

/// All that is served.
pub(crate) fn app(studio: Arc<Studio>, rules: Guard) -> Router {
    let broken = |_| (StatusCode::INTERNAL_SERVER_ERROR, "a mistake of this program; go on").into_response();
    routes(studio)
        .merge(page())
        .layer(middleware::from_fn_with_state(rules, guard))
        .layer(CatchPanicLayer::custom(broken))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    use axum::body::{Body, to_bytes};
    use axum::http::Request;
    use serde_json::{Value, json};
    use tower::ServiceExt as _;

    use crate::Sources;
    use crate::entry::Entry;
    use crate::moment::{Placed, Source, Verdict};
    use texreg_driver::Status;

    const TOKEN: &str = "0123456789abcdef";

    /// A studio on the fixture, its server, and its folder.
    struct Fixture {
        studio: Arc<Studio>,
        app: Router,
        folder: tempfile::TempDir,
    }

    fn sources(folder: &Path) -> Sources {
        let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/nefertiti");
        let photos = ["photo_00.jpg", "photo_01.jpg"].map(|file| case.join(file)).to_vec();
        let camera = Some(case.join("truth.json"));
        Sources { photos, folder: folder.to_owned(), camera, ..Sources::default() }
    }

    fn mesh() -> texreg_surface::Mesh {
        let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/nefertiti");
        texreg_surface::load(case.join("model.ply")).unwrap()
    }

    fn fixture() -> Fixture {
        let folder = tempfile::tempdir().unwrap();
        let studio = Studio::open(mesh(), "model.ply", &sources(folder.path())).unwrap();
        let app = app(Arc::clone(&studio), Guard { token: TOKEN.into(), loopback: true });
        Fixture { studio, app, folder }
    }

    fn request(method: &str, path: &str, headers: &[(&str, &str)], body: impl Into<Body>) -> Request<Body> {
        let mut request = Request::builder().method(method).uri(path);
        let has = |name: &str| headers.iter().any(|(other, _)| *other == name);
        if !has("host") {
            request = request.header("host", "127.0.0.1:1");
        }
        if !has("authorization") {
            request = request.header("authorization", format!("Bearer {TOKEN}"));
        }
        let headers = headers.iter().chain(&[("content-type", "application/json")]);
        headers.fold(request, |request, (name, value)| request.header(*name, *value)).body(body.into()).unwrap()
    }

    /// The answer's status and body.
    fn answer(app: &Router, request: Request<Body>) -> (u16, Vec<u8>) {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let answer = app.clone().oneshot(request).await.unwrap();
            let status = answer.status().as_u16();
            (status, to_bytes(answer.into_body(), 1 << 26).await.unwrap().to_vec())
        })
    }

    fn act(app: &Router, action: &Value) -> u16 {
        answer(app, request("POST", "/api/photo/0/act", &[], action.to_string())).0
    }

    const FRAME: &str = "/api/frame?r=1,0,0,0,1,0,0,0,1&t=0,0,5&f=100&w=64&h=48&shading=shaded&back=0,0,0&photo=0";

    #[test]
    fn only_the_page_itself_is_for_everyone() {
        let Fixture { app, .. } = fixture();
        type Headers = &'static [(&'static str, &'static str)];
        let cases: [(&str, Headers, u16); 12] = [
            ("/", &[("authorization", "")], 200),
            ("/main.js", &[("authorization", "")], 200),
            (FRAME, &[], 200),
            (FRAME, &[("origin", "http://127.0.0.1:1"), ("sec-fetch-site", "same-origin")], 200),
            (FRAME, &[("authorization", "Bearer 0123456789abcdee")], 401),
            (FRAME, &[("authorization", "")], 401),
            ("/api/photo/0/preview", &[("authorization", "Basic 0123456789abcdef")], 401),
            (FRAME, &[("host", "evil.example")], 403),
            ("/", &[("host", "evil.example:1")], 403),
            (FRAME, &[("host", "192.168.1.2:1")], 403),
            (FRAME, &[("origin", "http://evil.example")], 403),
            (FRAME, &[("sec-fetch-site", "cross-site")], 403),
        ];
        for (path, headers, expected) in cases {
            assert_eq!(answer(&app, request("GET", path, headers, "")).0, expected, "{path} {headers:?}");
        }
    }

    #[test]
    fn no_path_leads_out_and_no_number_is_too_bold() {
        let Fixture { app, .. } = fixture();
        for path in [
            "/../Cargo.toml",
            "/%2e%2e/Cargo.toml",
            "/style.css/../../Cargo.toml",
            "//etc/passwd",
            "/api/photo/..%2F..%2Fetc/preview",
            "/api/photo/-1/preview",
            "/api/photo/7/preview",
            "/api/photo/0/part?left=4000000000&top=0&width=4000&height=4000",
            "/api/photo/0/part?left=0&top=0&width=100000&height=100000",
            "/api/photo/0/overlay?left=NaN&top=0&width=1&height=1&w=9&h=9&kind=shaded&colour=1,2,3&at_work=false",
            "/api/frame?r=1,0,0&t=0,0,5&f=100&w=64&h=48&shading=shaded&back=0,0,0",
            "/api/frame?r=0,0,0,0,0,0,0,0,0&t=0,0,NaN&f=1&w=64&h=48&shading=shaded&back=0,0,0",
            "/api/frame?r=1,0,0,0,1,0,0,0,1&t=0,0,5&f=100&w=64000&h=48000&shading=shaded&back=0,0,0",
            "/api/frame?r=1,0,0,0,1,0,0,0,1&t=0,0,5&f=-1&w=64&h=48&shading=shaded&back=0,0,0",
            "/api/frame?r=1,0,0,0,1,0,0,0,1&t=0,0,5&f=100&w=64&h=48&shading=plaid&back=0,0,0",
        ] {
            let status = answer(&app, request("GET", path, &[], "")).0;
            assert!((400..500).contains(&status), "{path}: {status}");
        }
    }

    #[test]
    fn broken_messages_change_nothing() {
        let Fixture { app, studio, folder } = fixture();
        let long = "x".repeat(100_000);
        let messages = [
            (String::new(), 400),
            ("{".into(), 400),
            (json!({"do": "explode"}).to_string(), 422),
            (json!({"do": "photo", "uv": [1]}).to_string(), 422),
            (json!({"do": "delete", "pair": 3}).to_string(), 422),
            (json!({"do": "undo"}).to_string(), 422),
            (json!({"do": "accept"}).to_string(), 422),
            (json!({"do": "rename", "pair": 0, "name": long}).to_string(), 413),
        ];
        for (message, expected) in messages {
            let status = answer(&app, request("POST", "/api/photo/0/act", &[], message.clone())).0;
            assert_eq!(status, expected, "{message:.60}");
        }
        for order in
            [json!({"photos": [0]}), json!({"photos": [], "metric": "luck"}), json!({"photos": [], "signals": ["x"]})]
        {
            assert_eq!(answer(&app, request("POST", "/api/register", &[], order.to_string())).0, 422, "{order}");
        }
        assert_eq!(studio.project().entries[0].now, crate::moment::Moment::default());
        assert!(!folder.path().join("correspondences.json").exists());
    }

    #[test]
    fn every_click_is_on_disk_and_a_new_studio_goes_on() {
        let Fixture { app, studio, folder } = fixture();
        let pairs = texreg_formats::read_pairs(
            &Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/nefertiti/correspondences.json"),
        );
        let pairs = pairs.unwrap().remove(0).points;
        for (i, pair) in pairs.iter().enumerate() {
            let (uv, xyz) = (<[f64; 2]>::from(pair.pixel), <[f64; 3]>::from(pair.point));
            assert_eq!(act(&app, &json!({"do": "photo", "uv": uv})), 200);
            let saved = std::fs::read_to_string(folder.path().join("correspondences.json")).unwrap();
            assert!(saved.contains("pending"), "{saved}");
            assert_eq!(act(&app, &json!({"do": "model", "xyz": xyz})), 200);
            let saved = texreg_formats::read_pairs(&folder.path().join("correspondences.json")).unwrap();
            assert_eq!(saved[0].points[..], pairs[..=i]);
        }
        assert_eq!(act(&app, &json!({"do": "rename", "pair": 1, "name": "left ear"})), 200);
        assert_eq!(act(&app, &json!({"do": "model", "xyz": [0.0, 0.0, 0.0]})), 200);
        let second = Studio::open(mesh(), "model.ply", &sources(folder.path()));
        assert!(matches!(second, Err(Error::Taken(_))), "one folder, one studio");
        let before = studio.project().entries[0].now.clone();
        assert_eq!(before.status(), "picked");
        let verdict = Verdict {
            status: Status::Uncertain,
            reasons: vec!["small".into()],
            similarity: (0.5, 0.75),
            uncertainty: json!({"pixels": 1.5, "weakest": "distance"}),
        };
        let camera = before.camera.clone().map(|camera| Placed { verdict: Some(verdict.clone()), ..camera });
        let judge = |entry: &mut Entry| {
            entry.now.camera = camera;
            Ok(())
        };
        studio.project().change(1, judge).unwrap();
        // What another process would find.
        let copy = tempfile::tempdir().unwrap();
        for file in ["correspondences.json", "cameras.json"] {
            std::fs::copy(folder.path().join(file), copy.path().join(file)).unwrap();
        }
        let again = Studio::open(mesh(), "model.ply", &sources(copy.path())).unwrap();
        let now = again.project().entries[0].now.clone();
        assert_eq!((&now.pairs, now.pending, now.status()), (&before.pairs, before.pending, "picked"));
        let (now, before) = (now.camera.unwrap().view, before.camera.unwrap().view);
        assert_eq!(now.camera, before.camera);
        assert!((now.pose.matrix() - before.pose.matrix()).amax() < 1e-9);
        assert_eq!(again.project().entries[1].now.camera.as_ref().unwrap().verdict, Some(verdict));
    }

    #[test]
    fn a_click_on_either_side_is_found_on_the_other_through_the_lens() {
        let Fixture { app, studio, folder: _folder } = fixture();
        let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/nefertiti");
        let mut view = texreg_driver::read_truth(&case.join("truth.json")).unwrap().photos[0].view;
        view.camera.distortion = [-0.2, 0.1, 0.002, -0.001, 0.0].into();
        let place = |entry: &mut Entry| {
            entry.now.camera = Some(Placed::new(view, Source::File));
            Ok(())
        };
        studio.project().change(0, place).unwrap();
        let ask = |path: String| {
            let (status, body) = answer(&app, request("GET", &path, &[], ""));
            assert_eq!(status, 200, "{path}");
            serde_json::from_slice::<Value>(&body).unwrap()
        };
        let (width, height) = (f64::from(view.camera.width), f64::from(view.camera.height));
        let mut hits = 0;
        for (x, y) in (1..100).map(|i| (f64::from(i % 10) / 10.0 * width, f64::from(i / 10) / 10.0 * height)) {
            let found = ask(format!("/api/photo/0/ray?x={x}&y={y}"));
            let Ok([a, b, c]) = serde_json::from_value::<[f64; 3]>(found["xyz"].clone()) else { continue };
            let back = ask(format!("/api/photo/0/pixel?x={a}&y={b}&z={c}"));
            let [u, v]: [f64; 2] = serde_json::from_value(back["uv"].clone()).unwrap();
            assert!((u - x).hypot(v - y) < 1e-2, "({u}, {v}) for ({x}, {y})");
            hits += 1;
        }
        assert!(hits >= 10, "{hits}");
        let [x, y, z] = view.pose.center().coords.into();
        assert_eq!(ask(format!("/api/photo/0/pixel?x={x}&y={y}&z={z}"))["uv"], Value::Null);
    }

    #[test]
    fn a_panic_in_one_request_kills_nothing() {
        let Fixture { studio, folder: _folder, .. } = fixture();
        let poisoned = Arc::clone(&studio);
        let boom = axum::routing::get(move || async move {
            let _held = poisoned.project();
            if true {
                panic!("boom");
            }
        });
        let rules = Guard { token: TOKEN.into(), loopback: true };
        let broken = |_| StatusCode::INTERNAL_SERVER_ERROR.into_response();
        let app = app(studio, rules).merge(Router::new().route("/boom", boom)).layer(CatchPanicLayer::custom(broken));
        assert_eq!(answer(&app, request("GET", "/boom", &[], "")).0, 500);
        assert_eq!(act(&app, &json!({"do": "photo", "uv": [5.0, 6.0]})), 200);
    }

    #[test]
    fn a_click_on_the_model_is_on_its_surface() {
        let Fixture { app, studio, .. } = fixture();
        let mesh = &studio.mesh;
        let (centre, distance) = (mesh.centre(), 2.0 * mesh.diagonal());
        let at = format!("{},{},{}", -centre.x, -centre.y, distance - centre.z);
        let pick = |x: f64, y: f64| {
            let path = format!("/api/pick?r=1,0,0,0,1,0,0,0,1&t={at}&f=800&w=640&h=480&x={x}&y={y}");
            let (status, body) = answer(&app, request("GET", &path, &[], ""));
            assert_eq!(status, 200);
            serde_json::from_slice::<Value>(&body).unwrap()["xyz"].clone()
        };
        let mut hits = 0;
        for (x, y) in [(319.5, 239.5), (310.25, 200.75), (330.1, 260.9), (319.5, 150.0)] {
            let Ok(xyz) = serde_json::from_value::<[f64; 3]>(pick(x, y)) else { continue };
            hits += 1;
            let [a, b, c] = std::array::from_fn(|k| xyz[k] - centre[k]);
            let depth = c + distance;
            assert!((800.0 * a / depth + 319.5 - x).abs() < 1e-3 && (800.0 * b / depth + 239.5 - y).abs() < 1e-3);
        }
        assert!(hits >= 2, "{hits}");
        assert_eq!(pick(0.0, 0.0), Value::Null);
    }
}
