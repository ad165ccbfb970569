//! `texreg render`: what the metric sees of the model, as PNG.

use std::io::Cursor;

use image::ImageFormat;
use serde_json::json;
use texreg::driver::{Layer, base_name, layer, read_cameras};

use crate::Ending;
use crate::args::Render;
use crate::inputs::model;
use crate::output::{Output, print};

pub(crate) fn run(args: &Render, json: bool) -> anyhow::Result<Ending> {
    let cameras = read_cameras(&args.cameras)?;
    let output = Output::open(&args.output)?;
    let mesh = model(&args.model)?;
    let layers = if args.signal.is_empty() { Layer::of(&mesh) } else { args.signal.clone() };
    let mut written = Vec::new();
    for entry in &cameras.photos {
        let size = entry.lens.size.ok_or_else(|| {
            let file = args.cameras.display();
            anyhow::anyhow!("{file}: photo {}, fields width, height: are missing; add the photo's size", entry.file)
        })?;
        for &name in &layers {
            let picture = layer(&mesh, &entry.view(size), name).ok_or_else(|| {
                anyhow::anyhow!("{}: the model has no {name}; choose another --signal", args.model.display())
            })?;
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
