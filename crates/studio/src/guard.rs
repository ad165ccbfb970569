//! Who may talk to the studio.
//!
//! The page itself has no secrets and is given to anyone on this machine. Everything else wants the token of the run in an
//! `Authorization` header, which no other page can send without being asked first, and no page is ever told yes. On top of
//! that a request must be addressed to this machine by number or as localhost (a name that an attacker points here, DNS
//! rebinding, is refused), and must not come from another page (`Origin`, `Sec-Fetch-Site`).

use std::net::IpAddr;

use axum::extract::{Request, State};
use axum::http::header::{AUTHORIZATION, HOST, ORIGIN};
use axum::http::{HeaderMap, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};

use crate::token::same;

/// What the guard goes by.
#[derive(Clone, Debug)]
pub(crate) struct Guard {
    /// The secret of this run.
    pub(crate) token: String,
    /// Whether only this machine is served.
    pub(crate) loopback: bool,
}

/// Lets through what may pass; everything that is not the page needs the token.
pub(crate) async fn guard(State(guard): State<Guard>, request: Request, next: Next) -> Response {
    let is_api = request.uri().path().starts_with("/api/");
    match guard.check(request.headers(), is_api) {
        Ok(()) => next.run(request).await,
        Err((status, words)) => (status, words).into_response(),
    }
}

impl Guard {
    fn check(&self, headers: &HeaderMap, is_api: bool) -> Result<(), (StatusCode, &'static str)> {
        let text = |name| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
        let host = text(HOST).ok_or((StatusCode::BAD_REQUEST, "the request names no host"))?;
        if !self.is_here(host) {
            return Err((StatusCode::FORBIDDEN, "open the page by its number, http://127.0.0.1, not by another name"));
        }
        if text(ORIGIN).is_some_and(|origin| origin != format!("http://{host}"))
            || headers.get("sec-fetch-site").is_some_and(|site| site != "same-origin" && site != "none")
        {
            return Err((StatusCode::FORBIDDEN, "another page may not talk to this one"));
        }
        let sent = text(AUTHORIZATION).and_then(|value| value.strip_prefix("Bearer "));
        if is_api && !sent.is_some_and(|token| same(token, &self.token)) {
            let words = "this page is of an earlier run; open the address that texreg printed last";
            return Err((StatusCode::UNAUTHORIZED, words));
        }
        Ok(())
    }

    /// Whether a `Host` is this machine: its port may be a tunnel's.
    fn is_here(&self, host: &str) -> bool {
        let name = match host.rsplit_once(':') {
            Some((name, port)) if port.parse::<u16>().is_ok() && !name.ends_with(':') => name,
            _ => host,
        };
        if name.eq_ignore_ascii_case("localhost") {
            return true;
        }
        let number = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
        number.parse::<IpAddr>().is_ok_and(|address| address.is_loopback() || !self.loopback)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_numbers_and_localhost_are_here() {
        let inside = Guard { token: String::new(), loopback: true };
        let outside = Guard { loopback: false, ..inside.clone() };
        for host in ["127.0.0.1:8080", "localhost:1", "LOCALHOST", "[::1]:80", "127.0.0.1"] {
            assert!(inside.is_here(host) && outside.is_here(host), "{host}");
        }
        for host in ["evil.example:80", "localhost.evil.example", "127.0.0.1.evil.example:80", "", ":80", "[::1"] {
            assert!(!inside.is_here(host) && !outside.is_here(host), "{host}");
        }
        assert!(!inside.is_here("192.168.0.7:80") && outside.is_here("192.168.0.7:80"));
    }
}
