//! Reading matrices of an earlier estimator, which knew fewer parameters: those that came later stand
//! last, and are zero in what it wrote.

use nalgebra::{SMatrix, SVector};
use serde::de::Error;
use serde::{Deserialize, Deserializer};

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

/// A square matrix whose last rows and columns may be missing.
///
/// # Errors
/// When it is larger, or not square.
pub fn square<'de, D, const N: usize>(deserializer: D) -> Result<SMatrix<f64, N, N>, D::Error>
where
    D: Deserializer<'de>,
{
    let numbers = Vec::<f64>::deserialize(deserializer)?;
    let size = numbers.len().isqrt();
    if size > N || size * size != numbers.len() {
        return Err(D::Error::invalid_length(numbers.len(), &"a square matrix"));
    }
    let mut matrix = SMatrix::zeros();
    for (i, number) in numbers.into_iter().enumerate() {
        matrix[(i % size, i / size)] = number;
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
