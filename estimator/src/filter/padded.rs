//! Vectors and matrices of the filter in a checkpoint. Stored ones have an order of their own, that
//! in which parameters came to be known: where a new one is published and stands among the others
//! in memory, those that are stored keep their places. Those of an earlier estimator, which knew
//! fewer parameters, are read as well (later ones are missing at the end, and zero), and
//! covariances are written by halves.

use nalgebra::{SMatrix, SVector};
use serde::de::{DeserializeOwned, Error};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::parameters::STORED;
use super::{CALIBRATION, DIM, PARAMETERS};

/// Indices of the filter's states in memory, in the order in which they are stored.
const STORED_STATE: [usize; DIM] = state_of(&STORED);

/// Indices of a state: motion and anchor stand before the parameters.
const fn state_of<const N: usize, const M: usize>(parameters: &[usize; N]) -> [usize; M] {
    let mut state = [0; M];
    let mut i = 0;
    while i < M {
        state[i] = if i < CALIBRATION {
            i
        } else {
            CALIBRATION + parameters[i - CALIBRATION]
        };
        i += 1;
    }
    state
}

/// A matrix whose last columns may be missing.
///
/// # Errors
/// Returns an error when there are more numbers than it holds, or no whole column of them.
pub fn columns<'de, D, const R: usize, const C: usize>(
    deserializer: D,
) -> Result<SMatrix<f64, R, C>, D::Error>
where
    D: Deserializer<'de>,
{
    let numbers = Vec::<f64>::deserialize(deserializer)?;
    if numbers.len() > R * C || !numbers.len().is_multiple_of(R) {
        return Err(D::Error::invalid_length(
            numbers.len(),
            &"whole columns of a matrix",
        ));
    }
    let mut matrix = SMatrix::<f64, R, C>::zeros();
    for (into, number) in matrix.iter_mut().zip(numbers) {
        *into = number;
    }
    Ok(matrix)
}

/// Numbers that are stored in an order, the last of which may be missing; `None` of more than there are.
fn spread<T: Copy + Default, const N: usize>(stored: &[T], order: &[usize; N]) -> Option<[T; N]> {
    let mut spread = [T::default(); N];
    for (i, &one) in stored.iter().enumerate() {
        *spread.get_mut(*order.get(i)?)? = one;
    }
    Some(spread)
}

/// A square matrix, or the lower half of one, that is stored in an order, and whose last rows and columns may be
/// missing; `None` of one that is larger, or not square. No size of a half is a square here: that holds for all
/// up to 48 but 1 and 8.
fn spread_square<const N: usize>(
    numbers: &[f64],
    order: &[usize; N],
) -> Option<SMatrix<f64, N, N>> {
    let length = numbers.len();
    let size = length.isqrt();
    let size_of_half = ((8 * length + 1).isqrt() - 1) / 2;
    let mut matrix = SMatrix::zeros();
    let mut numbers = numbers.iter();
    if size * size == length {
        let order = order.get(..size)?;
        for (column, row) in order
            .iter()
            .flat_map(|&c| order.iter().map(move |&r| (c, r)))
        {
            matrix[(row, column)] = *numbers.next()?;
        }
    } else if size_of_half * (size_of_half + 1) == 2 * length {
        let order = order.get(..size_of_half)?;
        for (i, &column) in order.iter().enumerate() {
            for &row in order.iter().skip(i) {
                let number = *numbers.next()?;
                matrix[(row, column)] = number;
                matrix[(column, row)] = number;
            }
        }
    } else {
        return None;
    }
    Some(matrix)
}

/// The lower half of a matrix that equals its transpose to the bit, by columns in an order; all of another one.
fn gathered<const N: usize>(matrix: &SMatrix<f64, N, N>, order: &[usize; N]) -> Vec<f64> {
    let is_symmetric = *matrix == matrix.transpose();
    let columns = order.iter().enumerate().flat_map(|(i, &column)| {
        let first = if is_symmetric { i } else { 0 };
        order
            .iter()
            .skip(first)
            .map(move |&row| matrix[(row, column)])
    });
    columns.collect()
}

/// Content of a checkpoint in that order.
pub trait Stored: Sized {
    /// The numbers in the order.
    type Numbers: Serialize + DeserializeOwned;

    /// Brings them into the order.
    fn gather(&self) -> Self::Numbers;

    /// Reads them, of which the last may be missing; `None` of more than there are.
    fn of(numbers: &Self::Numbers) -> Option<Self>;
}

impl Stored for SVector<f64, PARAMETERS> {
    type Numbers = Vec<f64>;

    fn gather(&self) -> Vec<f64> {
        STORED.map(|i| self[i]).to_vec()
    }

    fn of(numbers: &Vec<f64>) -> Option<Self> {
        spread(numbers, &STORED).map(Self::from)
    }
}

impl Stored for Option<SVector<f64, PARAMETERS>> {
    type Numbers = Option<Vec<f64>>;

    fn gather(&self) -> Option<Vec<f64>> {
        self.as_ref().map(Stored::gather)
    }

    fn of(numbers: &Option<Vec<f64>>) -> Option<Self> {
        match numbers {
            Some(numbers) => Stored::of(numbers).map(Some),
            None => Some(None),
        }
    }
}

impl Stored for SMatrix<f64, PARAMETERS, PARAMETERS> {
    type Numbers = Vec<f64>;

    fn gather(&self) -> Vec<f64> {
        gathered(self, &STORED)
    }

    fn of(numbers: &Vec<f64>) -> Option<Self> {
        spread_square(numbers, &STORED)
    }
}

impl Stored for SMatrix<f64, DIM, DIM> {
    type Numbers = Vec<f64>;

    fn gather(&self) -> Vec<f64> {
        gathered(self, &STORED_STATE)
    }

    fn of(numbers: &Vec<f64>) -> Option<Self> {
        spread_square(numbers, &STORED_STATE)
    }
}

impl Stored for [bool; PARAMETERS] {
    type Numbers = Vec<bool>;

    fn gather(&self) -> Vec<bool> {
        let flags = STORED.iter().filter_map(|&i| self.get(i).copied());
        flags.collect()
    }

    fn of(flags: &Vec<bool>) -> Option<Self> {
        spread(flags, &STORED)
    }
}

/// Writes stored content in that order.
///
/// # Errors
/// Returns those of the serializer.
pub fn serialize<T: Stored, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
    value.gather().serialize(serializer)
}

/// Reads stored content in that order.
///
/// # Errors
/// Returns an error when there are more numbers than it holds, or those of a matrix are not square.
pub fn deserialize<'de, T: Stored, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    let numbers = T::Numbers::deserialize(deserializer)?;
    T::of(&numbers).ok_or_else(|| {
        let expected = format!("numbers by {PARAMETERS} parameters at most");
        D::Error::custom(format!(
            "got another number of numbers, expected {expected}"
        ))
    })
}

/// Flags of published parameters, the last of which may be missing and are unset then.
///
/// # Errors
/// Returns an error when there are more.
pub fn published<'de, D, const N: usize>(deserializer: D) -> Result<[bool; N], D::Error>
where
    D: Deserializer<'de>,
{
    let stored = Vec::<bool>::deserialize(deserializer)?;
    let order = std::array::from_fn(|i| i);
    spread(&stored, &order).ok_or_else(|| D::Error::invalid_length(stored.len(), &"fewer flags"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A layout with a ninth published parameter, which came after the seven hidden ones.
    const NINE: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 9, 10, 11, 12, 13, 14, 15, 8];

    /// Numbers stored by today's layout: one for each parameter, the same in each.
    fn by_today() -> [f64; 15] {
        std::array::from_fn(|i| i as f64 + 1.0)
    }

    #[test]
    fn a_ninth_published_parameter_shifts_no_stored_one() {
        let read = spread(&by_today(), &NINE).unwrap();
        assert_eq!(read[..8], by_today()[..8], "published");
        assert_eq!(read[8..9], [0.0], "the new one is not known yet");
        assert_eq!(read[9..], by_today()[8..], "hidden");
        assert_eq!(
            NINE.map(|i| read[i])[..15],
            by_today(),
            "and it is written last"
        );

        let today = SMatrix::<f64, 15, 15>::from_fn(|row, column| (row * column) as f64);
        let order = std::array::from_fn(|i| i);
        let half = gathered(&today, &order);
        assert_eq!(half.len(), 120);
        for stored in [half, today.as_slice().to_vec()] {
            let read = spread_square(&stored, &NINE).unwrap();
            let again = SMatrix::<f64, 15, 15>::from_fn(|i, j| read[(NINE[i], NINE[j])]);
            assert_eq!(again, today);
            assert!(
                read.row(8)
                    .iter()
                    .chain(read.column(8).iter())
                    .all(|&one| one == 0.0)
            );
            assert_eq!(spread_square(&gathered(&read, &NINE), &NINE), Some(read));
        }
        let of_state: [usize; 22] = state_of(&NINE);
        assert_eq!(of_state[..8], [0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(of_state[14..], [15, 16, 17, 18, 19, 20, 21, 14]);
    }

    /// Order of the checkpoints that robots have: a new parameter is written behind these.
    #[test]
    fn stored_parameters_keep_their_places() {
        use crate::estimate::Parameter as P;
        use crate::filter as hidden;
        let published = [
            P::SteeringOffset,
            P::LidarX,
            P::LidarY,
            P::LidarYaw,
            P::SpeedScale,
            P::Wheelbase,
            P::TimeOffset,
            P::SteeringGain,
        ];
        let hidden = [
            hidden::SIDE_SLIP,
            hidden::ASYMMETRY,
            hidden::QUADRATIC,
            hidden::CUBIC,
            hidden::STEERING_LAG,
            hidden::STEERING_SPREAD,
            hidden::STEERING_PLAY,
        ];
        assert_eq!(STORED[..8], published.map(P::index));
        assert_eq!(STORED[8..15], hidden);
        let mut sorted = STORED;
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..PARAMETERS), "each stands once");
    }

    #[test]
    fn more_than_there_is_room_for_is_refused() {
        assert_eq!(spread(&[0.0; 17], &NINE), None);
        assert_eq!(spread_square(&[0.0; 17 * 17], &NINE), None);
        assert_eq!(spread_square(&[0.0; 5], &NINE), None);
    }
}
