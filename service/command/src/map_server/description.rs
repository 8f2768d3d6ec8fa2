//! The YAML half of a map.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use fleetcal_estimator::occupancy_grid::Occupancy;
use fleetcal_model::Pose2;
use serde_json::Value;

use super::MapRefused;

/// Interpretation of the image's shades. All three distinguish occupied and free by the thresholds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    /// Darkness is the probability that a cell is occupied.
    Trinary,
    /// Darkness is the probability that a cell is occupied; shades in between are levels and leave
    /// the cell unknown.
    Scale,
    /// The shade itself is the occupancy in percent; above 100 the cell is unknown.
    Raw,
}

/// Content of the YAML file.
#[derive(Debug, Clone, PartialEq)]
pub struct Description {
    /// The image, beside the YAML file.
    pub image: PathBuf,
    /// Edge of a cell, m.
    pub resolution_m: f64,
    /// Lower left corner of the image in the map.
    pub grid_in_map: Pose2,
    negate: bool,
    occupied_thresh: f64,
    free_thresh: f64,
    mode: Mode,
}

/// Reason for refusing a description, without its file's name.
#[derive(Debug)]
pub enum DescriptionRefused {
    /// The text is not a YAML mapping.
    Yaml(String),
    /// A field holds an impossible value.
    Field {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: String,
        /// Accepted values.
        accepted: &'static str,
    },
}

impl DescriptionRefused {
    /// Makes the refusal of the file `path`.
    pub fn of(self, path: &Path) -> MapRefused {
        let path = path.to_owned();
        match self {
            Self::Yaml(reason) => MapRefused::Yaml { path, reason },
            Self::Field {
                field,
                value,
                accepted,
            } => MapRefused::Field {
                path,
                field,
                value,
                accepted,
            },
        }
    }
}

/// Fields of a description, as in the file.
struct Fields(BTreeMap<String, Value>);

impl Fields {
    /// Reads a field by `read`, which returns `None` for an impossible value.
    fn take<T>(
        &self,
        field: &'static str,
        accepted: &'static str,
        read: impl FnOnce(&Value) -> Option<T>,
    ) -> Result<T, DescriptionRefused> {
        let value = self.0.get(field);
        value.and_then(read).ok_or_else(|| {
            let value = value.map_or_else(|| "nothing".to_owned(), Value::to_string);
            DescriptionRefused::Field {
                field,
                value,
                accepted,
            }
        })
    }
}

impl Description {
    /// Parses the text of the file. Keys of other programs are ignored.
    ///
    /// # Errors
    /// Names the field that is missing or invalid, its value and the accepted values.
    pub fn parse(text: &str) -> Result<Self, DescriptionRefused> {
        let fields = serde_saphyr::from_str(text).map_err(|error| {
            let reason = error.to_string();
            DescriptionRefused::Yaml(reason.lines().next().unwrap_or_default().to_owned())
        })?;
        let fields = Fields(fields);
        let mode = match fields.0.get("mode") {
            None => Mode::Trinary,
            Some(_) => fields.take("mode", "trinary, scale or raw", mode)?,
        };
        let share = "a number from 0 to 1";
        let occupied_thresh = fields.take("occupied_thresh", share, share_of)?;
        let free_thresh = fields.take(
            "free_thresh",
            "a number from 0 to 1, below occupied_thresh",
            |value| share_of(value).filter(|share| *share < occupied_thresh),
        )?;
        Ok(Self {
            image: fields.take("image", "the name of an image file", |value| {
                let name = value.as_str().filter(|name| !name.is_empty());
                name.map(PathBuf::from)
            })?,
            resolution_m: fields.take("resolution", "metres a cell", Value::as_f64)?,
            grid_in_map: fields.take("origin", "[x, y, yaw] in metres and radians", pose)?,
            negate: fields.take("negate", "0 or 1", flag)?,
            occupied_thresh,
            free_thresh,
            mode,
        })
    }

    /// Returns the occupancy of a cell by its pixel's shade, 0 black and 255 white.
    pub fn occupancy(&self, shade: u8) -> Occupancy {
        let shade_share = f64::from(shade) / 255.0;
        let occupied = match self.mode {
            Mode::Raw if shade > 100 => return Occupancy::Unknown,
            Mode::Raw => f64::from(shade) / 100.0,
            Mode::Trinary | Mode::Scale if self.negate => shade_share,
            Mode::Trinary | Mode::Scale => 1.0 - shade_share,
        };
        if occupied >= self.occupied_thresh {
            Occupancy::Occupied
        } else if occupied <= self.free_thresh {
            Occupancy::Free
        } else {
            Occupancy::Unknown
        }
    }
}

fn mode(value: &Value) -> Option<Mode> {
    match value.as_str()? {
        "trinary" => Some(Mode::Trinary),
        "scale" => Some(Mode::Scale),
        "raw" => Some(Mode::Raw),
        _ => None,
    }
}

fn share_of(value: &Value) -> Option<f64> {
    value.as_f64().filter(|share| (0.0..=1.0).contains(share))
}

fn flag(value: &Value) -> Option<bool> {
    match (value.as_bool(), value.as_i64()) {
        (Some(flag), _) => Some(flag),
        (None, Some(number @ (0 | 1))) => Some(number == 1),
        _ => None,
    }
}

fn pose(value: &Value) -> Option<Pose2> {
    match value.as_array()?.as_slice() {
        [x, y, yaw] => Some(Pose2::new(x.as_f64()?, y.as_f64()?, yaw.as_f64()?)),
        _ => None,
    }
}
