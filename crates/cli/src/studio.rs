//! `texreg studio`: the local web page.

use std::net::SocketAddr;
use std::process::{Command, Stdio};

use serde_json::json;
use texreg_studio::{Sources, Studio, serve};

use crate::Ending;
use crate::args;
use crate::inputs::{model, name};
use crate::output::print;

pub(crate) fn run(args: &args::Studio, json: bool) -> anyhow::Result<Ending> {
    let sources = Sources {
        photos: args.photos.clone(),
        folder: args.output.clone(),
        pairs: args.pairs.clone(),
        init: args.init.clone(),
        camera: args.camera.clone(),
    };
    let mesh = model(&args.model)?;
    let studio = Studio::open(mesh, &name(&args.model), &sources)?;
    serve(&studio, SocketAddr::new(args.bind, args.port), |page| {
        let folder = args.output.display();
        let words = if json {
            json!({"page": page}).to_string()
        } else {
            format!("{page}\nYour work is kept in {folder}. Ctrl+C ends the studio.")
        };
        // Somebody who has gone away cannot be told.
        let _ = print(&words);
        if !args.no_open {
            open(page);
        }
    })?;
    Ok(Ending::Good)
}

/// Opens a page in the browser, if there is one; its address has been printed in any case.
fn open(page: &str) {
    let (program, first): (&str, &[&str]) = if cfg!(target_os = "macos") {
        ("open", &[])
    } else if cfg!(windows) {
        ("rundll32", &["url.dll,FileProtocolHandler"])
    } else {
        ("xdg-open", &[])
    };
    let mut command = Command::new(program);
    command.args(first).arg(page).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let _ = command.spawn();
}
