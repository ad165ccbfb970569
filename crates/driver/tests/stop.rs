//! A registration that is told to stop, on the fixture.

use std::ops::ControlFlow;
use std::path::Path;

use texreg_driver::{Error, Model, Options, Photo, register};
use texreg_formats::read_cameras;

#[test]
fn the_observer_can_stop_a_registration() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/nefertiti");
    let mesh = texreg_surface::load(folder.join("model.ply")).unwrap();
    let model = Model::new(&mesh, &[]).unwrap();
    let photo = Photo::load(folder.join("photo_00.jpg")).unwrap();
    let cameras = read_cameras(&folder.join("initial.json")).unwrap();
    let start = cameras.entry("photo_00.jpg").unwrap().view([photo.width, photo.height]);
    let mut stages = Vec::new();
    let outcome = register(&model, &photo, &start, &Options::default(), &mut |event| {
        stages.push(event.stage.name.clone());
        if stages.len() == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    assert_eq!(outcome, Err(Error::Stopped));
    assert_eq!(stages.len(), 2, "{stages:?}");
}
