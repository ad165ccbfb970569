//! `texreg render`: what the metric sees of the model, as PNG.

use std::io::Cursor;

use image::ImageFormat;
use serde_json::json;
use texreg::driver::layer;
use texreg::formats::{base_name, read_cameras};
use texreg::surface::{NoSuchSignal, Signal, SignalName, joint_signal};

use crate::Ending;
use crate::args::Render;
use crate::inputs::model;
use crate::output::{Output, print};

pub(crate) fn run(args: &Render, json: bool) -> anyhow::Result<Ending> {
    let cameras = read_cameras(&args.cameras)?;
    let output = Output::open(&args.output)?;
    let mesh = model(&args.model)?;
    let all = || SignalName::ALL.iter().copied().filter(|name| name.is_in(&mesh)).collect();
    let names = if args.signal.is_empty() { all() } else { args.signal.clone() };
    let signal = |&name| Ok((name, joint_signal(&mesh, &[name])?));
    let signals: Result<Vec<(SignalName, Box<dyn Signal>)>, _> = names.iter().map(signal).collect();
    let signals = signals.map_err(|e: NoSuchSignal| anyhow::anyhow!("{}: {e}", args.model.display()))?;
    let mut written = Vec::new();
    for entry in &cameras.photos {
        let size = entry.lens.size.ok_or_else(|| {
            let file = args.cameras.display();
            anyhow::anyhow!("{file}: photo {}, fields width, height: are missing; add the photo's size", entry.file)
        })?;
        for (name, signal) in &signals {
            let picture = layer(&mesh, &**signal, &entry.view(size));
            let mut png = Cursor::new(Vec::new());
            picture.write_to(&mut png, ImageFormat::Png)?;
            let file = format!("{}.{name}.png", base_name(&entry.file));
            output.write(&file, png.get_ref())?;
            written.push(output.path(&file).display().to_string());
        }
    }
    if json {
        print(&format!("{:#}", json!({"files": written})))?;
    } else {
        print(&written.join("\n"))?;
    }
    Ok(Ending::Good)
}
