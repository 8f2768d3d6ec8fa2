//! Maps as ROS's `map_server` saves them: a YAML file that names a PGM image and says how to read it.
//!
//! The image's shades become occupied, free and unknown cells by the two thresholds, in each of the
//! modes `trinary`, `scale` and `raw`.

mod description;
mod pgm;

use std::path::{Path, PathBuf};

use fleetcal_estimator::OccupancyGrid;
use fleetcal_estimator::stream::FieldRefused;
use thiserror::Error;

use description::Description;
use pgm::{PGM_BYTES_MAX, Pgm, PgmRefused};

/// Largest YAML file read, bytes.
pub const YAML_BYTES_MAX: u64 = 64 << 10;

/// Reason for which a map could not be used.
#[derive(Debug, Error)]
pub enum MapRefused {
    /// A file of the map could not be read.
    #[error("cannot read {path}: {source}", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// A file of the map is longer than any map.
    #[error("the map {path} is refused: it has {bytes} bytes, expected {bytes_max} at most", path = path.display())]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Its length, bytes.
        bytes: u64,
        /// Largest accepted length, bytes.
        bytes_max: u64,
    },
    /// The description is not a YAML mapping.
    #[error("the map {path} is refused: {reason}", path = path.display())]
    Yaml {
        /// The description.
        path: PathBuf,
        /// Error of the YAML parser.
        reason: String,
    },
    /// A field holds an impossible value.
    #[error("the map {path} is refused: {field}: got {value}, expected {accepted}", path = path.display())]
    Field {
        /// The file that holds it.
        path: PathBuf,
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: String,
        /// Accepted values.
        accepted: &'static str,
    },
}

impl MapRefused {
    fn field(path: &Path, refused: FieldRefused) -> Self {
        let FieldRefused {
            field,
            value,
            accepted,
        } = refused;
        Self::Field {
            path: path.to_owned(),
            field,
            value,
            accepted,
        }
    }

    /// True if the system could not read a file, which is no fault of the map.
    pub fn is_io(&self) -> bool {
        matches!(self, Self::Read { .. })
    }
}

/// Reads a map from its description; the image is expected beside it.
///
/// # Errors
/// Names the file and, for an invalid field, its name, value and accepted values.
pub fn read(yaml: &Path) -> Result<OccupancyGrid, MapRefused> {
    let text = read_text(yaml)?;
    let description = Description::parse(&text).map_err(|refused| refused.of(yaml))?;
    let image = yaml
        .parent()
        .unwrap_or(Path::new(""))
        .join(&description.image);
    let bytes = read_file(&image, PGM_BYTES_MAX)?;
    let pgm = Pgm::parse(&bytes).map_err(|refused| {
        let PgmRefused {
            field,
            value,
            accepted,
        } = refused;
        MapRefused::Field {
            path: image,
            field,
            value,
            accepted,
        }
    })?;
    // The lowest row comes last.
    let rows = pgm.shades.chunks_exact(pgm.width).rev();
    let cells = rows.flatten().map(|&shade| description.occupancy(shade));
    OccupancyGrid::new(
        description.resolution_m,
        description.grid_in_map,
        pgm.width,
        cells.collect(),
    )
    .map_err(|refused| MapRefused::field(yaml, refused))
}

fn read_text(path: &Path) -> Result<String, MapRefused> {
    String::from_utf8(read_file(path, YAML_BYTES_MAX)?).map_err(|error| MapRefused::Yaml {
        path: path.to_owned(),
        reason: error.to_string(),
    })
}

fn read_file(path: &Path, bytes_max: u64) -> Result<Vec<u8>, MapRefused> {
    let unread = |source| MapRefused::Read {
        path: path.to_owned(),
        source,
    };
    let bytes = std::fs::metadata(path).map_err(unread)?.len();
    if bytes > bytes_max {
        return Err(MapRefused::TooLong {
            path: path.to_owned(),
            bytes,
            bytes_max,
        });
    }
    std::fs::read(path).map_err(unread)
}

#[cfg(test)]
mod tests;
