//! Reading XML with errors that name the line and the field, and writing it.

use crate::FileError;
use roxmltree::Node;
use std::path::Path;

/// One element of an XML file.
#[derive(Clone, Copy)]
pub(crate) struct Element<'a> {
    path: &'a Path,
    pub(crate) node: Node<'a, 'a>,
}

/// Parses XML and hands its root element, which must have the given name, to `then`.
pub(crate) fn parse<T>(
    path: &Path,
    text: &str,
    root: &str,
    then: impl FnOnce(Element) -> Result<T, FileError>,
) -> Result<T, FileError> {
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
    let document = roxmltree::Document::parse_with_options(text, options)
        .map_err(|e| FileError::at(path, e.pos().row as usize, format!("is not well-formed XML: {e}")))?;
    let element = Element { path, node: document.root_element() };
    if element.name() != root {
        return Err(element.error(format!("the root element is <{}>, not <{root}>", element.name())));
    }
    then(element)
}

impl<'a> Element<'a> {
    pub(crate) fn name(&self) -> &'a str {
        self.node.tag_name().name()
    }

    /// An error at this element.
    pub(crate) fn error(&self, cause: impl std::fmt::Display) -> FileError {
        let line = self.node.document().text_pos_at(self.node.range().start).row;
        FileError::at(self.path, line as usize, cause)
    }

    /// The elements of a name right below this one.
    pub(crate) fn children(self, name: &'a str) -> impl Iterator<Item = Element<'a>> {
        let named = self.node.children().filter(move |node| node.has_tag_name(name));
        named.map(move |node| Element { path: self.path, node })
    }

    pub(crate) fn child(self, name: &'a str) -> Option<Element<'a>> {
        self.children(name).next()
    }

    /// The first element of a name right below this one, which must be there.
    pub(crate) fn need(self, name: &'a str) -> Result<Element<'a>, FileError> {
        self.child(name).ok_or_else(|| self.error(format!("<{}> lacks <{name}>", self.name())))
    }

    /// An attribute that must be there.
    pub(crate) fn attribute(&self, name: &str) -> Result<&'a str, FileError> {
        let missing = || self.error(format!("<{}> lacks the attribute {name}", self.name()));
        self.node.attribute(name).ok_or_else(missing)
    }

    /// An attribute of exactly `N` finite numbers separated by white space.
    pub(crate) fn numbers<const N: usize>(&self, attribute: &str) -> Result<[f64; N], FileError> {
        self.parse_numbers(attribute, self.attribute(attribute)?)
    }

    /// The text of exactly `N` finite numbers.
    pub(crate) fn text_numbers<const N: usize>(&self) -> Result<[f64; N], FileError> {
        self.parse_numbers(&format!("<{}>", self.name()), self.node.text().unwrap_or_default())
    }

    fn parse_numbers<const N: usize>(&self, field: &str, text: &str) -> Result<[f64; N], FileError> {
        let numbers = numbers(text).filter(|numbers| numbers.len() == N);
        let numbers = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
        numbers.ok_or_else(|| {
            let wanted = if N == 1 { "a number".to_owned() } else { format!("{N} numbers") };
            self.error(format!("field {field}: '{}' is not {wanted}", shortened(text)))
        })
    }
}

/// The finite numbers of a text; `None` if anything in it is none.
pub(crate) fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split_whitespace().map(|word| word.parse().ok().filter(|x: &f64| x.is_finite())).collect()
}

/// The beginning of a text, for an error of one line.
pub(crate) fn shortened(text: &str) -> String {
    let flat = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if flat.chars().count() > 40 { flat.chars().take(40).chain(['…']).collect() } else { flat }
}

/// Text as it may stand in an attribute or between tags.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
