//! What can be typed after `texreg`.

use std::fmt::Display;
use std::net::{IpAddr, Ipv4Addr};
use std::num::{NonZeroU32, NonZeroUsize};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{ArgGroup, Parser, Subcommand, ValueEnum};
use texreg::calib::Model;
use texreg::driver::{BinsName, ChannelName, MetricName, RotationName, SolverName};
use texreg::formats::Format;
use texreg::surface::SignalName;
use texreg::texture;

use crate::handover;

/// Lays photographs onto scanned 3D models.
#[derive(Debug, Parser)]
#[command(name = "texreg", version, max_term_width = 100)]
pub(crate) struct Args {
    /// Work with at most this many threads [default: one a core]
    #[arg(long, global = true, display_order = 100, value_name = "N")]
    pub(crate) threads: Option<NonZeroUsize>,
    /// Print the result to standard output as one JSON object
    #[arg(long, global = true, display_order = 101)]
    pub(crate) json: bool,
    /// What to do.
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Find each photo's camera, from point pairs or from a rough camera
    Register(Register),
    /// Find each photo's camera from point pairs alone
    Pose(Pose),
    /// Calibrate a camera from photos of a checkerboard
    Calibrate(Calibrate),
    /// Draw what the metric sees of the model, as PNG
    Render(Render),
    /// Compute what a model can be compared by besides what was measured, and store it with the model
    Signals(Signals),
    /// Lay the photos onto the model: a textured GLB or OBJ, or a PLY with coloured vertices
    Texture(Texture),
    /// Score cameras against the true ones
    Evaluate(Evaluate),
    /// Take cameras to and from other programs
    Convert(Convert),
    /// Pick pairs, register and judge on a local web page
    Studio(Studio),
}

/// What `register` and `pose` have in common.
#[derive(Debug, clap::Args)]
pub(crate) struct Inputs {
    /// The model: a mesh (PLY, OBJ, STL, OFF, glTF, MeshLab project) or a point cloud (PLY, LAS, LAZ, E57)
    pub(crate) model: PathBuf,
    /// The photos: JPEG, PNG or TIFF
    #[arg(required = true, value_name = "PHOTO")]
    pub(crate) photos: Vec<PathBuf>,
    /// Points of the model and the pixels that show them, four or more a photo: a correspondences.json
    #[arg(long, display_order = 0, value_name = "FILE")]
    pub(crate) pairs: Option<PathBuf>,
    /// Intrinsics and distortion: a camera.json, a calibration of OpenCV's, or cameras that name the photos [default: --init's,
    /// or EXIF's]
    #[arg(long, value_name = "FILE")]
    pub(crate) camera: Option<PathBuf>,
    /// The folder to write to
    #[arg(short, long, value_name = "DIR", default_value = "texreg-out")]
    pub(crate) output: PathBuf,
    /// Other programs' formats to write the cameras in as well, each in a folder of its name in DIR
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_parser = named(handover::FORMATS))]
    pub(crate) format: Vec<Format>,
}

/// `texreg register`
#[derive(Debug, clap::Args)]
#[command(group = ArgGroup::new("from").required(true).args(["pairs", "init", "start"]))]
pub(crate) struct Register {
    #[command(flatten)]
    pub(crate) inputs: Inputs,
    /// Start from these cameras: a cameras.json, or another program's file that `texreg convert` reads
    #[arg(long, display_order = 0, value_name = "FILE")]
    pub(crate) init: Option<PathBuf>,
    /// Start from nothing: search for the view
    #[arg(long, display_order = 0, value_name = "HOW")]
    pub(crate) start: Option<Start>,
    /// The measure of agreement
    #[arg(long, value_name = "NAME", default_value_t, value_parser = named(MetricName::ALL))]
    pub(crate) metric: MetricName,
    /// What of the photo is compared with the model
    #[arg(long, value_name = "NAME", default_value_t, value_parser = named(ChannelName::ALL))]
    pub(crate) channel: ChannelName,
    /// Bins of the photo's values: of equal width or of equal frequency
    #[arg(long, value_name = "NAME", default_value_t, value_parser = named(BinsName::ALL))]
    pub(crate) bins: BinsName,
    /// Where the photos show the object, white on black, for the metrics that compare silhouettes: an image, or a folder with one
    /// a photo, of the photo's name and as PNG [default: guessed from the colours of the photo's border]
    #[arg(long, value_name = "PATH")]
    pub(crate) mask: Option<PathBuf>,
    /// What the model predicts, several for their joint signal [default: reflectance, if the model has it, and normals]
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_parser = named(SignalName::ALL))]
    pub(crate) signal: Vec<SignalName>,
    /// The solver; photos are registered jointly by all but sgd
    #[arg(long, value_name = "NAME", default_value = "lm", value_parser = named(SolverName::ALL))]
    pub(crate) solver: SolverName,
    /// The chart a rotation is stepped in
    #[arg(long, value_name = "NAME", default_value = "lie", value_parser = named(RotationName::ALL))]
    pub(crate) rotation: RotationName,
    /// Parts of the camera to refine with the pose
    #[arg(long, value_name = "PART", value_delimiter = ',')]
    pub(crate) refine: Vec<Part>,
    /// Keep the focal length that --refine focal refines between these ends, in pixels
    #[arg(long, value_name = "MIN,MAX", value_parser = interval)]
    pub(crate) focal_range: Option<[f64; 2]>,
    /// Keep the principal point that --refine principal refines this near to where it starts along each axis, in pixels
    #[arg(long, value_name = "PX", value_parser = positive)]
    pub(crate) principal_within: Option<f64>,
    /// Keep the centre of the model's bounding box between these distances from the camera, along its axis, in model units
    #[arg(long, value_name = "MIN,MAX", value_parser = interval)]
    pub(crate) distance_range: Option<[f64; 2]>,
    /// Register all photos jointly: each is compared with the model and with the photos that see the same surface
    #[arg(long)]
    pub(crate) joint: bool,
    /// One camera took all photos: what --refine names is the same for all of them; implies --joint
    #[arg(long, requires = "refine")]
    pub(crate) share_intrinsics: bool,
    /// The seed of everything random
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u64,
}

impl Register {
    /// What the options' names alone cannot tell of those that do not go together.
    pub(crate) fn contradiction(&self) -> Option<&'static str> {
        let refines = |part| self.refine.contains(&part);
        if self.focal_range.is_some() && !refines(Part::Focal) {
            Some("--focal-range bounds what --refine focal refines: add it")
        } else if self.principal_within.is_some() && !refines(Part::Principal) {
            Some("--principal-within bounds what --refine principal refines: add it")
        } else if (self.joint || self.share_intrinsics) && self.solver == SolverName::StochasticGradient {
            Some("--solver sgd draws its batches from one photo: photos are registered jointly by the others")
        } else {
            None
        }
    }

    /// Every option that shapes the result, and its value; `signals` are those that the model predicts.
    pub(crate) fn options(&self, signals: &[SignalName]) -> [(&'static str, String); 10] {
        let list = |names: Vec<String>, none: &str| if names.is_empty() { none.to_owned() } else { names.join(",") };
        let photos = match (self.share_intrinsics, self.joint) {
            (true, _) => "joint, one camera",
            (false, true) => "joint",
            (false, false) => "independent",
        };
        let ends = |[least, most]: [f64; 2]| format!("{least} to {most}");
        let bounds = [
            self.focal_range.map(|range| format!("focal {}", ends(range))),
            self.principal_within.map(|off| format!("principal within {off}")),
            self.distance_range.map(|range| format!("distance {}", ends(range))),
        ];
        let parts = self.refine.iter().filter_map(|part| Some(part.to_possible_value()?.get_name().to_owned()));
        [
            ("metric", self.metric.to_string()),
            ("channel", self.channel.to_string()),
            ("bins", self.bins.to_string()),
            ("signal", signals.iter().map(ToString::to_string).collect::<Vec<_>>().join(",")),
            ("solver", self.solver.to_string()),
            ("rotation", self.rotation.to_string()),
            ("refine", list(parts.collect(), "pose")),
            ("bounds", list(bounds.into_iter().flatten().collect(), "none")),
            ("photos", photos.to_owned()),
            ("seed", self.seed.to_string()),
        ]
    }
}

/// Where to start with neither pairs nor cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Start {
    /// Look at the model from everywhere
    Search,
}

/// A part of the camera that can be refined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Part {
    /// The focal length
    Focal,
    /// The principal point
    Principal,
    /// The distortion coefficients
    Distortion,
}

/// `texreg pose`
#[derive(Debug, clap::Args)]
#[command(group = ArgGroup::new("start").required(true).args(["pairs"]))]
pub(crate) struct Pose {
    #[command(flatten)]
    pub(crate) inputs: Inputs,
}

/// `texreg calibrate`
#[derive(Debug, clap::Args)]
pub(crate) struct Calibrate {
    /// Three or more photos of the board, of one camera at one zoom: JPEG, PNG or TIFF
    #[arg(required = true, value_name = "IMAGE")]
    pub(crate) images: Vec<PathBuf>,
    /// The board's inner corners: columns, then rows
    #[arg(long, display_order = 0, value_name = "COLSxROWS", value_parser = size)]
    pub(crate) board: (usize, usize),
    /// The side of a square, in the unit that poses shall have
    #[arg(long, display_order = 0, value_name = "SIZE", value_parser = positive)]
    pub(crate) square: f64,
    /// The lens model, or the one the photos speak for: pinhole has no distortion, radial1 and radial2 have k1 and k2,
    /// brown4 adds p1 and p2, brown5 k3
    #[arg(long, value_name = "NAME", default_value = "auto", value_parser = model)]
    pub(crate) model: Lens,
    /// Use every photo with a board, even one that does not go with the others
    #[arg(long)]
    pub(crate) keep_all: bool,
    /// The file to write, .yml for a calibration of OpenCV's; the report goes beside it, as .html
    #[arg(short, long, value_name = "FILE", default_value = "camera.json")]
    pub(crate) output: PathBuf,
    /// Write each photo with its corners drawn to this folder
    #[arg(long, value_name = "DIR")]
    pub(crate) debug: Option<PathBuf>,
}

/// A lens model, or none chosen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lens(pub(crate) Option<Model>);

fn model(name: &str) -> Result<Lens, String> {
    let names = || Model::ALL.iter().map(|model| model.name()).collect::<Vec<_>>().join(", ");
    match name {
        "auto" => Ok(Lens(None)),
        name => name.parse().map(|model| Lens(Some(model))).map_err(|_| format!("not one of auto, {}", names())),
    }
}

/// Reads COLSxROWS.
fn size(text: &str) -> Result<(usize, usize), String> {
    let sides = text.split_once(['x', 'X', '×']).and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
    let sides = sides.ok_or("the inner corners are written as columns x rows, as in 9x6")?;
    match sides {
        (2..=200, 2..=200) => Ok(sides),
        _ => Err("a board has from 2 to 200 inner corners along each side".into()),
    }
}

/// Reads two positive numbers, the second of them the greater.
fn interval(text: &str) -> Result<[f64; 2], String> {
    let ends = text.split_once(',').and_then(|(a, b)| Some([positive(a.trim()).ok()?, positive(b.trim()).ok()?]));
    ends.filter(|[least, most]| least < most).ok_or_else(|| "is written as two numbers above zero, MIN,MAX".into())
}

/// Reads a positive number.
fn positive(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x: &f64| *x > 0.0 && x.is_finite()).ok_or_else(|| "must be a number above zero".into())
}

/// `texreg render`
#[derive(Debug, clap::Args)]
pub(crate) struct Render {
    /// The model: a mesh (PLY, OBJ, STL, OFF, glTF, MeshLab project) or a point cloud (PLY, LAS, LAZ, E57)
    pub(crate) model: PathBuf,
    /// The cameras to see it from: a cameras.json
    #[arg(long, value_name = "FILE")]
    pub(crate) cameras: PathBuf,
    /// What to draw, one or more [default: all that the model has]
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_parser = named(SignalName::ALL))]
    pub(crate) signal: Vec<SignalName>,
    /// The folder to write to
    #[arg(short, long, value_name = "DIR", default_value = "texreg-out")]
    pub(crate) output: PathBuf,
}

/// `texreg convert`
#[derive(Debug, clap::Args)]
pub(crate) struct Convert {
    /// The file of cameras to read; for COLMAP a folder
    pub(crate) input: PathBuf,
    /// The file to write; for COLMAP a folder. Cameras are added to a .glb that is there already
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// The format of the input [default: by its name]
    #[arg(long, value_name = "NAME", value_parser = named(Format::ALL))]
    pub(crate) from: Option<Format>,
    /// The format of the output [default: by its name]
    #[arg(long, value_name = "NAME", value_parser = named(Format::ALL))]
    pub(crate) to: Option<Format>,
    /// The folder of the photos [default: the input's]
    #[arg(long, value_name = "DIR")]
    pub(crate) photos: Option<PathBuf>,
    /// The model that the output shall name [default: the one the input names]
    #[arg(long, value_name = "MODEL")]
    pub(crate) model: Option<PathBuf>,
}

/// `texreg texture`
#[derive(Debug, clap::Args)]
pub(crate) struct Texture {
    /// The model: a triangle mesh in a PLY or OBJ file
    pub(crate) model: PathBuf,
    /// The photos' cameras: a cameras.json; photos whose registration failed are left out
    #[arg(long, display_order = 0, value_name = "FILE")]
    pub(crate) cameras: PathBuf,
    /// The folder of the photos [default: beside the cameras, beside the model, or this one]
    #[arg(long, display_order = 0, value_name = "DIR")]
    pub(crate) photos: Option<PathBuf>,
    /// The texture's width and height in texels [default: the photos' own resolution, up to 8192]
    #[arg(long, value_name = "N", value_parser = texels)]
    pub(crate) size: Option<NonZeroU32>,
    /// How the photos that see a place are blended
    #[arg(long, value_name = "NAME", value_enum, default_value_t)]
    pub(crate) blend: Blend,
    /// What becomes of places that no photo sees
    #[arg(long, value_name = "NAME", value_enum, default_value_t)]
    pub(crate) unseen: Unseen,
    /// Leave exposure and white balance as they are
    #[arg(long)]
    pub(crate) no_balance: bool,
    /// Colour the vertices instead of making a texture; the file is a PLY
    #[arg(long)]
    pub(crate) vertex_colours: bool,
    /// The file to write: .glb, .obj (with .mtl and .png beside it) or .ply (coloured vertices)
    #[arg(short, long, value_name = "FILE", default_value = "textured.glb", default_value_if("vertex_colours", "true", "textured.ply"), value_parser = textured)]
    pub(crate) output: PathBuf,
}

impl Texture {
    /// The format of the file to write.
    pub(crate) fn format(&self) -> ModelFormat {
        if self.vertex_colours { ModelFormat::Ply } else { ModelFormat::of(&self.output).unwrap_or(ModelFormat::Glb) }
    }
}

/// A format of textured models.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ModelFormat {
    Glb,
    Obj,
    Ply,
}

impl ModelFormat {
    fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "glb" => Some(Self::Glb),
            "obj" => Some(Self::Obj),
            "ply" => Some(Self::Ply),
            _ => None,
        }
    }
}

/// Reads the name of a file whose format is known.
fn textured(name: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(name);
    match ModelFormat::of(&path) {
        Some(_) => Ok(path),
        None => Err("its name must end in .glb, .obj or .ply".into()),
    }
}

/// Reads the side of a texture.
fn texels(text: &str) -> Result<NonZeroU32, String> {
    let side = text.parse().ok().filter(|side: &NonZeroU32| (64..=32768).contains(&side.get()));
    side.ok_or_else(|| "must be a whole number from 64 to 32768".into())
}

/// How the photos that see a place are blended.
#[derive(Clone, Copy, Debug, Default, clap::ValueEnum)]
pub(crate) enum Blend {
    /// Low frequencies from all alike, high ones by how well a photo sees the place
    #[default]
    #[value(name = "multiband")]
    MultiBand,
    /// The best photo alone
    Best,
    /// The mean of all
    Mean,
}

impl From<Blend> for texture::Blend {
    fn from(blend: Blend) -> Self {
        match blend {
            Blend::MultiBand => Self::MultiBand,
            Blend::Best => Self::Best,
            Blend::Mean => Self::Mean,
        }
    }
}

/// What becomes of places that no photo sees.
#[derive(Clone, Copy, Debug, Default, clap::ValueEnum)]
pub(crate) enum Unseen {
    /// Colours spread into them over the surface
    #[default]
    Inpaint,
    /// They are magenta
    Mark,
}

impl From<Unseen> for texture::Unseen {
    fn from(unseen: Unseen) -> Self {
        match unseen {
            Unseen::Inpaint => Self::Inpaint,
            Unseen::Mark => Self::Mark,
        }
    }
}

/// `texreg signals`
#[derive(Debug, clap::Args)]
pub(crate) struct Signals {
    /// The model: a triangle mesh in a PLY or OBJ file
    pub(crate) model: PathBuf,
    /// The PLY file to write: the model with ambient_occlusion and mean_curvature at each vertex
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
}

/// `texreg evaluate`
#[derive(Debug, clap::Args)]
pub(crate) struct Evaluate {
    /// The cameras to score: a cameras.json
    pub(crate) cameras: PathBuf,
    /// The true cameras: a cameras.json with bbox_diagonal, and width, height and visible_points in each entry
    #[arg(long, value_name = "FILE")]
    pub(crate) truth: PathBuf,
}

/// `texreg studio`
#[derive(Debug, clap::Args)]
pub(crate) struct Studio {
    /// The model: PLY, OBJ, STL, OFF, glTF, or a MeshLab project
    pub(crate) model: PathBuf,
    /// The photos: JPEG, PNG or TIFF
    #[arg(required = true, value_name = "PHOTO")]
    pub(crate) photos: Vec<PathBuf>,
    /// Pairs to begin with, where the folder has none: a correspondences.json
    #[arg(long, display_order = 0, value_name = "FILE")]
    pub(crate) pairs: Option<PathBuf>,
    /// Cameras to begin with, where the folder has none: a cameras.json
    #[arg(long, display_order = 0, value_name = "FILE")]
    pub(crate) init: Option<PathBuf>,
    /// Intrinsics and distortion: a camera.json, or a cameras.json that names the photos [default: --init's, or EXIF's]
    #[arg(long, value_name = "FILE")]
    pub(crate) camera: Option<PathBuf>,
    /// The folder the work is kept in; one that has some is gone on with
    #[arg(short, long, value_name = "DIR", default_value = "texreg-out")]
    pub(crate) output: PathBuf,
    /// The port of the page, 0 for a free one
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) port: u16,
    /// The address to serve at; with another than this machine's own, everybody who has the page's address can use it
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    pub(crate) bind: IpAddr,
    /// Only print the page's address, open no browser
    #[arg(long)]
    pub(crate) no_open: bool,
}

/// Reads one of the names that `all` the values have.
fn named<T>(all: &'static [T]) -> impl TypedValueParser<Value = T>
where
    T: Clone + Display + FromStr<Err = String> + Send + Sync + 'static,
{
    PossibleValuesParser::new(all.iter().map(ToString::to_string)).try_map(|name| name.parse())
}
