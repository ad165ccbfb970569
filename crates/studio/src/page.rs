//! The page itself, part of the program.

use axum::Router;
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS,
};
use axum::response::IntoResponse as _;
use axum::routing::get;

/// Nothing but what this program sends, and pictures it made.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

macro_rules! files {
    ($($path:literal => $file:literal, $kind:literal;)+) => {
        &[$(($path, $kind, include_bytes!(concat!("../assets/", $file)))),+]
    };
}

/// Address, kind and contents of each file.
const FILES: &[(&str, &str, &[u8])] = files! {
    "/" => "index.html", "text/html; charset=utf-8";
    "/style.css" => "style.css", "text/css; charset=utf-8";
    "/icon.svg" => "icon.svg", "image/svg+xml";
    "/main.js" => "main.js", "text/javascript; charset=utf-8";
    "/server.js" => "server.js", "text/javascript; charset=utf-8";
    "/maths.js" => "maths.js", "text/javascript; charset=utf-8";
    "/pointer.js" => "pointer.js", "text/javascript; charset=utf-8";
    "/photo.js" => "photo.js", "text/javascript; charset=utf-8";
    "/overlay.js" => "overlay.js", "text/javascript; charset=utf-8";
    "/model.js" => "model.js", "text/javascript; charset=utf-8";
    "/loupe.js" => "loupe.js", "text/javascript; charset=utf-8";
    "/markers.js" => "markers.js", "text/javascript; charset=utf-8";
    "/lists.js" => "lists.js", "text/javascript; charset=utf-8";
    "/keys.js" => "keys.js", "text/javascript; charset=utf-8";
    "/words.js" => "words.js", "text/javascript; charset=utf-8";
};

/// The page's files.
pub(crate) fn page() -> Router {
    FILES.iter().fold(Router::new(), |router, &(path, kind, bytes)| {
        let headers = [
            (CONTENT_TYPE, kind),
            (CACHE_CONTROL, "no-store"),
            (CONTENT_SECURITY_POLICY, POLICY),
            (REFERRER_POLICY, "no-referrer"),
            (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        ];
        router.route(path, get(move || async move { (headers, bytes).into_response() }))
    })
}
