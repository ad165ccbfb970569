//! BAL files: `cameras points observations`, a line `camera point x y` an observation, then nine numbers a camera and three
//! a point, separated by white space.

use crate::snavely::TRANSLATION;
use crate::{Bundle, Columns, Observation, SnavelyCamera};
use nalgebra::{Point3, Vector2};
use std::fmt::Write;

/// What is wrong with a BAL file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BalError {
    /// The file ends early.
    #[error("ends where {0} should be")]
    Ends(&'static str),
    /// Something is no number, or not a finite one.
    #[error("line {line}: '{text}' is no {what}")]
    NoNumber {
        /// The line, from 1.
        line: usize,
        /// What stands there, its beginning.
        text: String,
        /// What should.
        what: &'static str,
    },
    /// An observation names a camera or a point that is not there.
    #[error("line {line}: {what} {index} of {count}")]
    NoSuch {
        /// The line, from 1.
        line: usize,
        /// `camera` or `point`.
        what: &'static str,
        /// The index.
        index: u32,
        /// How many there are.
        count: u32,
    },
    /// Something follows the last point.
    #[error("line {line}: '{text}' follows the last point")]
    Follows {
        /// The line, from 1.
        line: usize,
        /// What stands there, its beginning.
        text: String,
    },
}

/// The words of a text with their lines.
struct Words<'a> {
    lines: std::iter::Enumerate<std::str::Lines<'a>>,
    words: std::str::SplitAsciiWhitespace<'a>,
    line: usize,
}

impl<'a> Words<'a> {
    fn next(&mut self) -> Option<&'a str> {
        loop {
            if let Some(word) = self.words.next() {
                return Some(word);
            }
            let (index, line) = self.lines.next()?;
            (self.words, self.line) = (line.split_ascii_whitespace(), index + 1);
        }
    }

    fn parse<T: std::str::FromStr>(&mut self, what: &'static str) -> Result<T, BalError> {
        let word = self.next().ok_or(BalError::Ends(what))?;
        word.parse().map_err(|_| BalError::NoNumber { line: self.line, text: short(word), what })
    }

    fn number(&mut self, what: &'static str) -> Result<f64, BalError> {
        let word = self.next().ok_or(BalError::Ends(what))?;
        let number = word.parse().ok().filter(|x: &f64| x.is_finite());
        number.ok_or_else(|| BalError::NoNumber { line: self.line, text: short(word), what })
    }

    fn index(&mut self, what: &'static str, count: u32) -> Result<u32, BalError> {
        let index = self.parse(what)?;
        if index < count { Ok(index) } else { Err(BalError::NoSuch { line: self.line, what, index, count }) }
    }
}

fn short(word: &str) -> String {
    word.chars().take(24).collect()
}

/// Reads a BAL problem.
///
/// # Errors
/// If the text is not one; the error names the line.
pub fn read_bal(text: &str) -> Result<Bundle<SnavelyCamera>, BalError> {
    let mut words = Words { lines: text.lines().enumerate(), words: "".split_ascii_whitespace(), line: 0 };
    let (cameras, points) = (words.parse::<u32>("number of cameras")?, words.parse::<u32>("number of points")?);
    let observations = words.parse::<u32>("number of observations")?;
    // The counts are only believed as far as the text goes.
    let room = |count: u32, bytes: usize| (count as usize).min(text.len() / bytes);
    let mut bundle = Bundle {
        cameras: Vec::with_capacity(room(cameras, 18)),
        points: Vec::with_capacity(room(points, 6)),
        observations: Vec::with_capacity(room(observations, 8)),
    };
    for _ in 0..observations {
        let (camera, point) = (words.index("camera", cameras)?, words.index("point", points)?);
        let pixel = Vector2::new(words.number("pixel")?, words.number("pixel")?);
        bundle.observations.push(Observation { camera, point, pixel });
    }
    for _ in 0..cameras {
        let mut numbers = [0.0; 9];
        for number in &mut numbers {
            *number = words.number("parameter of a camera")?;
        }
        bundle.cameras.push(SnavelyCamera::from_array(numbers));
    }
    for _ in 0..points {
        let mut next = || words.number("coordinate of a point");
        bundle.points.push(Point3::new(next()?, next()?, next()?));
    }
    match words.next() {
        Some(word) => Err(BalError::Follows { line: words.line, text: short(word) }),
        None => Ok(bundle),
    }
}

/// Writes a BAL problem, with every digit.
pub fn write_bal(bundle: &Bundle<SnavelyCamera>) -> String {
    let mut text = format!("{} {} {}\n", bundle.cameras.len(), bundle.points.len(), bundle.observations.len());
    let mut write = |line: std::fmt::Arguments| writeln!(text, "{line}").expect("a string takes everything");
    for Observation { camera, point, pixel } in &bundle.observations {
        write(format_args!("{camera} {point} {:e} {:e}", pixel.x, pixel.y));
    }
    let cameras = bundle.cameras.iter().flat_map(SnavelyCamera::to_array);
    for number in cameras.chain(bundle.points.iter().flat_map(|point| [point.x, point.y, point.z])) {
        write(format_args!("{number:e}"));
    }
    text
}

/// The columns that fix the gauge: the pose of the first camera, and of the camera farthest from it the component of the
/// translation that moves most with the scale of the world. `None` for fewer than two places.
pub fn fixed_gauge(cameras: &[SnavelyCamera], mut columns: Columns<9>) -> Option<Columns<9>> {
    let first = cameras.first()?;
    let from_first =
        |camera: &SnavelyCamera| camera.pose.translation + camera.pose.rotation * first.pose.center().coords;
    let (farthest, offset) = cameras
        .iter()
        .map(from_first)
        .enumerate()
        .max_by(|(_, a), (_, b)| a.norm_squared().total_cmp(&b.norm_squared()))
        .filter(|(_, offset)| offset.norm_squared() > 0.0)?;
    for parameter in 0..TRANSLATION.end {
        columns = columns.fix(0, parameter);
    }
    Some(columns.fix(farthest, TRANSLATION.start + offset.iamax()))
}
