//! Report of a study: words, tables, figures, and the figures it is held to.

mod markdown;

use std::fs;
use std::path::Path;

use crate::error::EvaluationError;

/// A table. The first column is left-aligned, the others right-aligned.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    header: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// Makes a table without rows.
    pub fn new(header: &[&str]) -> Self {
        Self {
            header: header.iter().map(|&name| name.to_owned()).collect(),
            rows: Vec::new(),
        }
    }

    /// Adds a row.
    pub fn row(&mut self, cells: impl IntoIterator<Item = impl Into<String>>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }
}

/// A drawn figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Name of its file, without a suffix.
    pub name: &'static str,
    /// Its content, in a sentence.
    pub caption: String,
    /// The drawing.
    pub svg: String,
}

/// A piece of a section.
#[derive(Debug, Clone, PartialEq)]
enum Block {
    Words(String),
    Table(Table),
    Figure(Figure),
}

/// A number with a required bound.
#[derive(Debug, Clone, PartialEq)]
pub struct Claim {
    /// Measured quantity.
    pub what: String,
    /// Required bound.
    pub bound: String,
    /// Measured value.
    pub seen: String,
    /// True if the bound is kept.
    pub holds: bool,
}

/// One study.
#[derive(Debug, Clone, PartialEq)]
pub struct Section {
    /// Its heading.
    pub heading: String,
    blocks: Vec<Block>,
    /// Claims of the study.
    pub claims: Vec<Claim>,
}

impl Section {
    /// Makes a study without content.
    pub fn new(heading: &str) -> Self {
        Self {
            heading: heading.to_owned(),
            blocks: Vec::new(),
            claims: Vec::new(),
        }
    }

    /// Adds a paragraph.
    pub fn words(&mut self, words: impl Into<String>) {
        self.blocks.push(Block::Words(words.into()));
    }

    /// Adds a table.
    pub fn table(&mut self, table: Table) {
        self.blocks.push(Block::Table(table));
    }

    /// Adds a figure.
    pub fn figure(&mut self, figure: Figure) {
        self.blocks.push(Block::Figure(figure));
    }

    /// Claims that a number is not above a bound; `show` formats both.
    pub fn at_most(&mut self, what: &str, seen: f64, bound: f64, show: impl Fn(f64) -> String) {
        self.claims.push(Claim {
            what: what.to_owned(),
            bound: format!("at most {}", show(bound)),
            seen: show(seen),
            holds: seen <= bound,
        });
    }

    /// Claims that a number is not below a bound.
    pub fn at_least(&mut self, what: &str, seen: f64, bound: f64, show: impl Fn(f64) -> String) {
        self.claims.push(Claim {
            what: what.to_owned(),
            bound: format!("at least {}", show(bound)),
            seen: show(seen),
            holds: seen >= bound,
        });
    }

    /// Writes the study alone as Markdown, its figures as links.
    pub fn markdown(&self) -> String {
        markdown::section_text(self)
    }

    fn figures(&self) -> impl Iterator<Item = &Figure> {
        self.blocks.iter().filter_map(|block| match block {
            Block::Figure(figure) => Some(figure),
            Block::Words(_) | Block::Table(_) => None,
        })
    }
}

/// All studies, and their origin.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Commit of the source.
    pub commit: String,
    /// Command that makes it again.
    pub command: String,
    /// Extent of the simulation, in words.
    pub extent: String,
    /// The studies.
    pub sections: Vec<Section>,
}

impl Report {
    /// Returns the claims that do not hold.
    pub fn short_of(&self) -> Vec<&Claim> {
        let claims = self.sections.iter().flat_map(|section| &section.claims);
        claims.filter(|claim| !claim.holds).collect()
    }

    /// Writes `evaluation.md` into a folder, and its figures into `evaluation/` beside it.
    ///
    /// # Errors
    /// Names the file that cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), EvaluationError> {
        let figures = folder.join("evaluation");
        fs::create_dir_all(&figures).map_err(|source| EvaluationError::Written {
            path: figures.clone(),
            source,
        })?;
        write_file(&folder.join("evaluation.md"), &markdown::page(self))?;
        for figure in self.sections.iter().flat_map(Section::figures) {
            write_file(&figures.join(format!("{}.svg", figure.name)), &figure.svg)?;
        }
        Ok(())
    }
}

fn write_file(path: &Path, text: &str) -> Result<(), EvaluationError> {
    fs::write(path, text).map_err(|source| EvaluationError::Written {
        path: path.to_owned(),
        source,
    })
}
