//! `texreg signals`: what is computed of a model, stored with it.

use std::time::Instant;

use serde_json::{Value, json};
use texreg::formats::write_atomic;
use texreg::surface::Mesh;

use crate::Ending;
use crate::args::Signals;
use crate::inputs::model;
use crate::output::{print, table};

/// Computes a value for each vertex, unless the model has them already.
type Compute = fn(&Mesh) -> &[f32];

/// The properties of the file, and what computes them.
const PROPERTIES: [(&str, Compute); 2] =
    [("ambient_occlusion", Mesh::ambient_occlusion), ("mean_curvature", Mesh::mean_curvature)];

pub(crate) fn run(args: &Signals, json: bool) -> anyhow::Result<Ending> {
    let file = args.output.display().to_string();
    if args.output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("ply")) {
        anyhow::bail!("{file}: signals are stored in a PLY file; give it a name that ends in .ply");
    }
    let mesh = model(&args.model)?;
    let computed = PROPERTIES.map(|(property, compute)| {
        let began = Instant::now();
        let values = compute(&mesh);
        let milliseconds = began.elapsed().as_secs_f64() * 1e3;
        let range = values.iter().fold((f32::MAX, f32::MIN), |(low, high), &v| (low.min(v), high.max(v)));
        (property, range, milliseconds)
    });
    let mut bytes = Vec::new();
    mesh.write_ply(&mut bytes)?;
    write_atomic(&args.output, &bytes)?;
    if json {
        let property = |(name, (least, greatest), ms): &(&str, (f32, f32), f64)| -> Value {
            json!({"property": name, "least": least, "greatest": greatest, "milliseconds": ms})
        };
        let properties: Vec<Value> = computed.iter().map(property).collect();
        print(&format!("{:#}", json!({"file": file, "properties": properties})))?;
    } else {
        let mut rows = vec![["property", "least", "greatest", "ms", ""].map(str::to_owned).to_vec()];
        rows.extend(computed.iter().map(|(name, (least, greatest), ms)| {
            vec![(*name).to_owned(), format!("{least:.3}"), format!("{greatest:.3}"), format!("{ms:.0}"), String::new()]
        }));
        print(&format!("{}written to {file}", table(&rows)))?;
    }
    Ok(Ending::Good)
}
