//! The studio in a real browser, on the fixture: pairs are clicked, the server is killed and started again, the photo is
//! registered and accepted, and the file of cameras is right.

#[path = "common/browser.rs"]
mod browser;
mod common;

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use browser::Browser;
use common::{fixture, run};
use serde_json::Value;
use texreg::camera::View;
use texreg::driver::read_truth;
use texreg::formats::{read_cameras, read_pairs};

const DELETE: &str = "\u{e017}";
const ESCAPE: &str = "\u{e00c}";

/// A studio at work, killed when it goes.
struct Server(Child, String);

impl Server {
    fn start(folder: &Path) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_texreg"));
        command.arg("studio").arg(fixture("model.ply")).args(["photo_00.jpg", "photo_01.jpg"].map(fixture));
        command.arg("--camera").arg(fixture("truth.json")).arg("-o").arg(folder).args(["--no-open", "--json"]);
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let page: Value = serde_json::from_str(&line).unwrap();
        Self(child, page["page"].as_str().unwrap().to_owned())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // No warning: nothing may be lost.
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

/// The page as a person sees it.
struct Page<'a>(&'a Browser);

impl Page<'_> {
    fn open(&self, server: &Server) {
        // Another address than the last: the token after # alone would not load the page anew.
        self.0.go("about:blank");
        self.0.go(&server.1);
        self.0.wait(
            "document.documentElement.dataset.linked === 'true' && !!document.getElementById('photo').dataset.view",
        );
        self.still();
    }

    /// Waits until the model is drawn in full and every change has arrived.
    fn still(&self) {
        sleep(Duration::from_millis(60));
        self.0.wait("document.getElementById('model').dataset.still === '1'");
    }

    fn pairs(&self) -> usize {
        self.0.value("document.querySelectorAll('#pairs td.number').length").as_u64().unwrap() as usize
    }

    fn canvas(&self, id: &str) -> ([f64; 4], Value) {
        let expression = format!(
            "(c => {{ const b = c.getBoundingClientRect(); return [b.x, b.y, b.width, b.height, c.dataset.view] }})\
             (document.getElementById('{id}'))"
        );
        let value = self.0.value(&expression);
        let view = serde_json::from_str(value[4].as_str().unwrap()).unwrap();
        ([0, 1, 2, 3].map(|k| value[k].as_f64().unwrap()), view)
    }

    /// Where on the screen a pixel of the photo is.
    fn photo(&self, uv: [f64; 2]) -> [f64; 2] {
        let ([left, top, ..], view) = self.canvas("photo");
        let number = |key: &str| view[key].as_f64().unwrap();
        [left + (uv[0] + 0.5) * number("s") + number("x"), top + (uv[1] + 0.5) * number("s") + number("y")]
    }

    /// Where on the screen a point of the model is, and the rotation it is seen by.
    fn model(&self, point: [f64; 3]) -> ([f64; 2], [f64; 9]) {
        let ([left, top, ..], view) = self.canvas("model");
        let r: [f64; 9] = serde_json::from_value(view["r"].clone()).unwrap();
        let t: [f64; 3] = serde_json::from_value(view["t"].clone()).unwrap();
        let p: [f64; 3] = std::array::from_fn(|i| (0..3).map(|k| r[3 * i + k] * point[k]).sum::<f64>() + t[i]);
        let number = |key: &str| view[key].as_f64().unwrap();
        let at = |x: f64, centre: &str| number("f") * x / p[2] + number(centre) + 0.5;
        ([left + at(p[0], "cx"), top + at(p[1], "cy")], r)
    }

    /// Turns the model to the side that looks most like the photo.
    fn turn_to(&self, truth: &View) {
        let wanted: Vec<f64> = truth.pose.rotation.matrix().transpose().iter().copied().collect();
        let mut sides = Vec::new();
        for _ in 0..12 {
            self.still();
            let (_, r) = self.model([0.0; 3]);
            sides.push(r.iter().zip(&wanted).map(|(a, b)| a * b).sum::<f64>());
            self.0.press("v");
        }
        let best = (0..sides.len()).max_by(|a, b| sides[*a].total_cmp(&sides[*b])).unwrap();
        (0..best).for_each(|_| self.0.press("v"));
        self.still();
        let ([left, top, width, height], _) = self.canvas("model");
        let middle = [left + 0.5 * width, top + 0.5 * height];
        self.0.drag(middle, [middle[0] + 60.0, middle[1]]);
        self.still();
    }

    /// Clicks a pair, unless there is one close by; what the model does not show there is taken back.
    fn pick(&self, point: [f64; 3], truth: &View, folder: &Path) {
        let before = self.pairs();
        let pixel = truth.project(&point.into()).unwrap();
        let saved = read_pairs(&folder.join("correspondences.json")).unwrap_or_default();
        if saved.iter().flat_map(|entry| &entry.points).any(|pair| (pair.pixel - pixel).norm() < 60.0) {
            return;
        }
        self.0.click(self.photo(pixel.into()));
        self.0.wait("document.getElementById('next').textContent.startsWith('Now click')");
        self.still();
        self.0.click(self.model(point).0);
        if !(0..20).any(|_| {
            sleep(Duration::from_millis(50));
            self.pairs() > before
        }) {
            self.0.press(ESCAPE);
            return self.0.wait("!document.getElementById('next').textContent.startsWith('Now click')");
        }
        let saved = read_pairs(&folder.join("correspondences.json")).unwrap();
        let found = saved[0].points.last().unwrap().point;
        if (found - nalgebra::Point3::from(point)).norm() > 8.0 {
            self.0.press(DELETE);
            self.0.wait(&format!("document.querySelectorAll('#pairs td.number').length === {before}"));
        }
    }
}

#[test]
fn six_pairs_are_clicked_and_a_photo_is_registered_and_accepted() {
    let Some(browser) = Browser::open([1440, 900]) else {
        eprintln!("skipped: chromium and chromedriver are not installed (apt-get install chromium chromium-driver)");
        return;
    };
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path().join("out");
    let truth = read_truth(&fixture("truth.json")).unwrap();
    let photo = &truth.photos[0];
    let page = Page(&browser);

    let server = Server::start(&folder);
    page.open(&server);
    page.turn_to(&photo.view);
    // Points of the surface that the photo shows, from everywhere on it.
    let mut points = photo.visible.iter().step_by(83).cycle().take(60).map(|p| <[f64; 3]>::from(*p));
    while page.pairs() < 4 {
        page.pick(points.next().expect("four pairs"), &photo.view, &folder);
    }
    browser.wait("document.documentElement.dataset.status === 'picked'");
    // Half a pair waits when the server is killed.
    browser.click(page.photo([30.0, 30.0]));
    browser.wait("document.getElementById('next').textContent.startsWith('Now click')");
    drop(server);
    browser.wait("document.documentElement.dataset.linked === 'false'");

    let server = Server::start(&folder);
    page.open(&server);
    assert_eq!(page.pairs(), 4);
    browser.wait("document.getElementById('next').textContent.startsWith('Now click')");
    browser.press(ESCAPE);
    browser.wait("!document.getElementById('next').textContent.startsWith('Now click')");
    while page.pairs() < 6 {
        page.pick(points.next().expect("six pairs"), &photo.view, &folder);
    }
    let registered =
        "document.documentElement.dataset.status === 'registered' && document.documentElement.dataset.busy === 'false'";
    browser.press("r");
    browser.wait(registered);
    let verdict = "document.getElementById('verdict').textContent";
    let before = browser.value(verdict);
    assert!(before.as_str().is_some_and(|words| words.contains("Sure to ±")), "{before}");
    // By another metric and another signal.
    browser.wait("!!(document.getElementById('metric').value = 'mi')");
    browser.wait("document.querySelector('#signals [value=normals]').click() === undefined");
    browser.press("r");
    browser.wait(&format!("{registered} && {verdict} !== {before}"));
    browser.press("a");
    browser.wait("document.documentElement.dataset.status === 'accepted'");
    assert_eq!(
        browser.complaints().iter().filter(|line| !line.contains("ERR_")).count(),
        0,
        "{:?}",
        browser.complaints()
    );

    let cameras = read_cameras(&folder.join("cameras.json")).unwrap();
    assert_eq!(cameras.photos[0].other["status"], "registered");
    assert_eq!(cameras.photos[0].other["accepted"], true);
    assert!(cameras.photos[0].other["uncertainty"]["pixels"].as_f64().is_some_and(|pixels| pixels < 2.0));
    let score =
        run(&folder, &["evaluate", "cameras.json", "--truth", &fixture("truth.json").display().to_string(), "--json"]);
    // The other photos have no camera yet.
    assert_eq!(score.status, 3, "{}", score.stderr);
    let score: Value = serde_json::from_str(&score.stdout).unwrap();
    assert_eq!(score["photos"][0]["ok"], true, "{score:#}");
}
