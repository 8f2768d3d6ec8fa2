//! Lists in pages: how many entries a page has, and where the next one begins.

use fleetcal_domain::limits;

use super::extract::number_within;
use super::problem::Problem;

/// Parses the number of entries of a page, 1 to [`limits::HTTP_PAGE_MAX`].
///
/// # Errors
/// A [`Problem`] for any other number.
pub fn page_limit(limit: Option<&str>) -> Result<u32, Problem> {
    let all = 1..=limits::HTTP_PAGE_MAX;
    number_within("limit", limit, all, limits::HTTP_PAGE_DEFAULT)
}

/// Returns the number of entries to read for a page of `limit`: one more shows whether there is
/// another page.
pub fn with_next(limit: u32) -> u32 {
    limit.saturating_add(1)
}

/// Cuts a list that was read [`with_next`]; returns the next page's cursor, made of the last entry
/// that stays.
pub fn cut<T>(entries: &mut Vec<T>, limit: u32, cursor: impl Fn(&T) -> String) -> Option<String> {
    let more = entries.len() > limit as usize;
    entries.truncate(limit as usize);
    entries.last().filter(|_| more).map(cursor)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_page_begins_behind_the_last_entry() {
        let page = |entries: u32| {
            let mut entries: Vec<u32> = (1..=entries).collect();
            let next = cut(&mut entries, 3, u32::to_string);
            (entries.len(), next)
        };
        assert_eq!(page(0), (0, None));
        assert_eq!(page(3), (3, None));
        assert_eq!(page(with_next(3)), (3, Some("3".to_owned())));
    }
}
