//! Matrices in a checkpoint: those of an earlier estimator, which knew fewer parameters, are read as well
//! (those that came later stand last, and are zero in what it wrote), and covariances are written by halves.

use nalgebra::{SMatrix, SVector};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A matrix whose last columns may be missing.
///
/// # Errors
/// When there are more numbers than it holds, or no whole column of them.
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

/// A vector whose last numbers may be missing.
///
/// # Errors
/// When there are more numbers than it holds.
pub fn vector<'de, D, const N: usize>(deserializer: D) -> Result<SVector<f64, N>, D::Error>
where
    D: Deserializer<'de>,
{
    let row: SMatrix<f64, 1, N> = columns(deserializer)?;
    Ok(row.transpose())
}

/// The same where there may be none.
///
/// # Errors
/// When there are more numbers than it holds.
pub fn optional_vector<'de, D, const N: usize>(
    deserializer: D,
) -> Result<Option<SVector<f64, N>>, D::Error>
where
    D: Deserializer<'de>,
{
    #[derive(Deserialize)]
    struct Padded<const N: usize>(#[serde(deserialize_with = "vector")] SVector<f64, N>);
    let given = Option::<Padded<N>>::deserialize(deserializer)?;
    Ok(given.map(|Padded(vector)| vector))
}

/// The lower half of a matrix that equals its transpose to the bit, by columns; all of another one.
///
/// # Errors
/// Those of the serializer.
pub fn half<S, const N: usize>(
    matrix: &SMatrix<f64, N, N>,
    serializer: S,
) -> Result<S::Ok, S::Error>
where
    S: Serializer,
{
    if *matrix != matrix.transpose() {
        return matrix.as_slice().serialize(serializer);
    }
    let columns = (0..N).flat_map(|column| (column..N).map(move |row| matrix[(row, column)]));
    columns.collect::<Vec<f64>>().serialize(serializer)
}

/// A square matrix, or the lower half of one, whose last rows and columns may be missing. No size of a half
/// is a square here: that holds for all up to 48 but 1 and 8.
///
/// # Errors
/// When it is larger, or not square.
pub fn square<'de, D, const N: usize>(deserializer: D) -> Result<SMatrix<f64, N, N>, D::Error>
where
    D: Deserializer<'de>,
{
    let numbers = Vec::<f64>::deserialize(deserializer)?;
    let length = numbers.len();
    let size = length.isqrt();
    let size_of_half = ((8 * length + 1).isqrt() - 1) / 2;
    let mut matrix = SMatrix::zeros();
    let mut numbers = numbers.into_iter();
    if size <= N && size * size == length {
        for (column, row) in (0..size).flat_map(|column| (0..size).map(move |row| (column, row))) {
            matrix[(row, column)] = numbers.next().unwrap_or_default();
        }
    } else if size_of_half <= N && size_of_half * (size_of_half + 1) == 2 * length {
        let lower = (0..size_of_half)
            .flat_map(|column| (column..size_of_half).map(move |row| (column, row)));
        for (column, row) in lower {
            let number = numbers.next().unwrap_or_default();
            matrix[(row, column)] = number;
            matrix[(column, row)] = number;
        }
    } else {
        return Err(D::Error::invalid_length(length, &"a square matrix"));
    }
    Ok(matrix)
}

/// Flags, the last of which may be missing and are unset then.
///
/// # Errors
/// When there are more.
pub fn flags<'de, D, const N: usize>(deserializer: D) -> Result<[bool; N], D::Error>
where
    D: Deserializer<'de>,
{
    let given = Vec::<bool>::deserialize(deserializer)?;
    if given.len() > N {
        return Err(D::Error::invalid_length(given.len(), &"fewer flags"));
    }
    Ok(std::array::from_fn(|i| {
        given.get(i).copied().unwrap_or(false)
    }))
}
