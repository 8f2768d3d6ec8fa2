//! Lists and files that are written while they are read: rows come from the database some at a time,
//! the next ones once the client has taken those before. A client that stops to read holds no row of
//! the database and no transaction.

use std::io;
use std::sync::Arc;

use axum::body::{Body, Bytes};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use fleetcal_domain::limits;
use fleetcal_store::StoreError;
use futures::future::BoxFuture;
use futures::{Stream, StreamExt, stream};
use serde::Serialize;

use super::page::{cut, with_next};
use super::problem::Problem;

/// Rows of a database, each with the number by which the next one is found.
pub type Numbered<Row> = Vec<(i64, Row)>;

/// Converts the number of a record to the databases' type.
pub fn number(id: u64) -> i64 {
    i64::try_from(id).unwrap_or(i64::MAX)
}

/// Rows that are being read.
pub type Reading<Row> = BoxFuture<'static, Result<Numbered<Row>, StoreError>>;

/// The rows of a list, in the order of their numbers.
pub struct Rows<Row> {
    /// Reads a limited number of rows after a number.
    read: Box<dyn FnMut(Option<i64>, u32) -> Reading<Row> + Send>,
    after: Option<i64>,
    /// Number of rows that may still be read.
    left: u32,
}

/// Some of the rows.
struct Chunk<Row> {
    rows: Vec<Row>,
    /// True if the list ends with them.
    is_last: bool,
    /// Number from which the list continues after its end.
    next: Option<String>,
}

impl<Row> Rows<Row> {
    /// Makes the rows after a number, at most `limit`.
    pub fn new(
        after: Option<i64>,
        limit: u32,
        read: impl FnMut(Option<i64>, u32) -> Reading<Row> + Send + 'static,
    ) -> Self {
        Self {
            read: Box::new(read),
            after,
            left: limit,
        }
    }

    /// Reads the next rows.
    async fn next(&mut self) -> Result<Chunk<Row>, StoreError> {
        let limit = self.left.min(limits::LIST_ROWS_AT_ONCE);
        let mut rows = (self.read)(self.after, with_next(limit)).await?;
        let next = cut(&mut rows, limit, |(number, _)| number.to_string());
        self.left -= limit;
        self.after = rows.last().map(|(number, _)| *number);
        let is_last = next.is_none() || self.left == 0;
        Ok(Chunk {
            rows: rows.into_iter().map(|(_, row)| row).collect(),
            is_last,
            next: next.filter(|_| is_last),
        })
    }
}

/// Layout of written rows.
pub enum Layout<Row> {
    /// A page as JSON: `items`, and `next` unless it is the last one.
    Page,
    /// One row as JSON in each line.
    Ndjson,
    /// A table.
    Csv {
        /// Its first line.
        head: &'static str,
        /// Formats the line of a row.
        line: fn(&Row) -> String,
    },
}

impl<Row> Clone for Layout<Row> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<Row> Copy for Layout<Row> {}

impl<Row: Serialize> Layout<Row> {
    /// Formats some rows.
    fn text(self, chunk: &Chunk<Row>, is_first: bool) -> serde_json::Result<String> {
        let mut text = String::new();
        match self {
            Self::Page => {
                if is_first {
                    text.push_str("{\"items\":[");
                }
                for (index, row) in chunk.rows.iter().enumerate() {
                    if index > 0 || !is_first {
                        text.push(',');
                    }
                    text.push_str(&serde_json::to_string(row)?);
                }
                if chunk.is_last {
                    text.push(']');
                    if let Some(next) = &chunk.next {
                        text.push_str(",\"next\":");
                        text.push_str(&serde_json::to_string(next)?);
                    }
                    text.push('}');
                }
            }
            Self::Ndjson => {
                for row in &chunk.rows {
                    text.push_str(&serde_json::to_string(row)?);
                    text.push('\n');
                }
            }
            Self::Csv { head, line } => {
                if is_first {
                    text.push_str(head);
                }
                text.extend(chunk.rows.iter().map(line));
            }
        }
        Ok(text)
    }
}

/// Answers with a page of a list.
///
/// # Errors
/// A [`Problem`] if the first rows cannot be read.
pub async fn page<Row>(rows: Rows<Row>) -> Result<Response, Problem>
where
    Row: Serialize + Send + 'static,
{
    let pieces = text(rows, Layout::Page).await?;
    let body = Body::from_stream(pieces);
    Ok(([(header::CONTENT_TYPE, "application/json")], body).into_response())
}

/// Reads and writes rows as the pieces are requested. A failure ends the stream with an error,
/// which breaks the connection off, so that clients do not mistake a part for the whole.
///
/// # Errors
/// A [`Problem`] if the first rows cannot be read.
pub async fn text<Row>(
    mut rows: Rows<Row>,
    layout: Layout<Row>,
) -> Result<impl Stream<Item = io::Result<Bytes>> + Send + 'static, Problem>
where
    Row: Serialize + Send + 'static,
{
    let first = rows.next().await?;
    Ok(stream::try_unfold(
        Some((rows, Some(first))),
        move |state| {
            async move {
                let Some((mut rows, first)) = state else {
                    return Ok(None);
                };
                let is_first = first.is_some();
                let chunk = match first {
                    Some(chunk) => chunk,
                    None => rows.next().await.map_err(broken_off)?,
                };
                let is_last = chunk.is_last;
                // Off the threads on which everybody is answered.
                let writing = tokio::task::spawn_blocking(move || layout.text(&chunk, is_first));
                let text = writing.await.map_err(broken_off)?.map_err(broken_off)?;
                let next = (!is_last).then_some((rows, None));
                Ok(Some((Bytes::from(text), next)))
            }
        },
    ))
}

/// Writes `count` pieces of a text as they are requested, each off the threads on which requests
/// are answered.
pub fn pieces(
    count: usize,
    write: impl Fn(usize) -> serde_json::Result<String> + Send + Sync + 'static,
) -> impl Stream<Item = io::Result<Bytes>> + Send + 'static {
    let write = Arc::new(write);
    stream::iter(0..count).then(move |piece| {
        let write = Arc::clone(&write);
        async move {
            let writing = tokio::task::spawn_blocking(move || write(piece));
            let text = writing.await.map_err(broken_off)?;
            text.map(Bytes::from).map_err(broken_off)
        }
    })
}

fn broken_off(error: impl std::error::Error + Send + Sync + 'static) -> io::Error {
    tracing::warn!(%error, "an answer was broken off");
    io::Error::other(error)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use futures::FutureExt;

    use super::*;

    /// Makes the numbers below `total`, a counter of those read, and a failure from some number on.
    fn numbers(total: u32, limit: u32, fails_from: u32) -> (Rows<u32>, Arc<AtomicU32>) {
        let count = Arc::<AtomicU32>::default();
        let read = Arc::clone(&count);
        let rows = Rows::new(None, limit, move |after: Option<i64>, limit| {
            let from = after.map_or(0, |after| u32::try_from(after).unwrap() + 1);
            let to = total.min(from + limit);
            read.store(to, Ordering::Relaxed);
            let failure = || StoreError::Refused(fleetcal_domain::approval::Refused::NoMaintenance);
            let found = if to > fails_from {
                Err(failure())
            } else {
                Ok((from..to).map(|number| (number.into(), number)).collect())
            };
            std::future::ready(found).boxed()
        });
        (rows, count)
    }

    async fn whole(total: u32, limit: u32, layout: Layout<u32>) -> String {
        let (rows, _) = numbers(total, limit, u32::MAX);
        let pieces = text(rows, layout).await.unwrap();
        let pieces: Vec<_> = pieces.map(Result::unwrap).collect().await;
        String::from_utf8(pieces.concat()).unwrap()
    }

    #[tokio::test]
    async fn what_nobody_takes_is_not_read() {
        let (rows, read) = numbers(1_000_000, 1_000_000, u32::MAX);
        let mut pieces = Box::pin(text(rows, Layout::Ndjson).await.unwrap());
        for piece in 1..=3 {
            pieces.next().await.unwrap().unwrap();
            let read = read.load(Ordering::Relaxed);
            assert_eq!(read, piece * limits::LIST_ROWS_AT_ONCE + 1);
        }
    }

    #[tokio::test]
    async fn a_list_of_any_length_is_whole() {
        let at_once = limits::LIST_ROWS_AT_ONCE;
        for total in [0, 1, at_once - 1, at_once, at_once + 1, 3 * at_once, 1_000] {
            let lines = whole(total, 10_000, Layout::Ndjson).await;
            let expected: Vec<_> = (0..total).map(|number| number.to_string()).collect();
            assert_eq!(lines.lines().collect::<Vec<_>>(), expected);
            for limit in [1, at_once, at_once + 1, 500] {
                let page = whole(total, limit, Layout::Page).await;
                let page: serde_json::Value = serde_json::from_str(&page).unwrap();
                let count = total.min(limit);
                assert_eq!(
                    page["items"],
                    serde_json::json!((0..count).collect::<Vec<_>>())
                );
                let next = (total > limit).then(|| (count - 1).to_string());
                assert_eq!(page["next"].as_str(), next.as_deref(), "{total} {limit}");
            }
        }
        let layout = Layout::Csv {
            head: "number\r\n",
            line: |number| format!("{number}\r\n"),
        };
        assert_eq!(whole(0, 9, layout).await, "number\r\n");
        assert_eq!(whole(2, 9, layout).await, "number\r\n0\r\n1\r\n");
    }

    #[tokio::test]
    async fn a_failure_is_a_problem_or_ends_what_was_begun() {
        let (rows, _) = numbers(1_000, 1_000, 10);
        assert!(page(rows).await.is_err());
        let (rows, _) = numbers(1_000, 1_000, 300);
        let pieces = text(rows, Layout::Ndjson).await.unwrap();
        let pieces: Vec<_> = pieces.collect().await;
        let are_there: Vec<_> = pieces.iter().map(Result::is_ok).collect();
        assert_eq!(are_there, [true, true, false]);
    }
}
