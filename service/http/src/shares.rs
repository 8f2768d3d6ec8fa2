//! Places of which each holder has a few at most.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Number of places of each holder. Holders without any are forgotten.
#[derive(Debug, Clone)]
pub struct Shares {
    each_max: usize,
    held: Arc<Mutex<HashMap<String, usize>>>,
}

/// Place of one holder, which is freed on drop.
#[derive(Debug)]
pub struct Share {
    holder: String,
    shares: Shares,
}

impl Shares {
    /// Makes places with at most `each_max` for each holder.
    pub fn new(each_max: usize) -> Self {
        Self {
            each_max,
            held: Arc::default(),
        }
    }

    /// Allocates a place for `holder`; `None` if it has reached its limit.
    pub fn take(&self, holder: String) -> Option<Share> {
        let mut held = self.held();
        let count = held.entry(holder.clone()).or_default();
        if *count >= self.each_max {
            return None;
        }
        *count += 1;
        drop(held);
        Some(Share {
            holder,
            shares: self.clone(),
        })
    }

    fn held(&self) -> MutexGuard<'_, HashMap<String, usize>> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        let mut held = self.shares.held();
        if let Some(count) = held.get_mut(&self.holder) {
            *count = count.saturating_sub(1);
            if *count == 0 {
                held.remove(&self.holder);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_holder_has_its_own_places() {
        let shares = Shares::new(2);
        let take = |holder: &str| shares.take(holder.to_owned());
        let (first, _second) = (take("a").unwrap(), take("a").unwrap());
        assert!(take("a").is_none());
        let other = take("b").unwrap();
        drop(first);
        assert!(take("a").is_some());
        drop(other);
        assert_eq!(shares.held().len(), 1, "who has none is forgotten");
    }
}
