//! Requests and answers: parameters, bodies, conditions, pages and problem
//! documents. It knows no route.

pub mod cookie;
pub mod csv;
pub mod etag;
pub mod extract;
pub mod listing;
pub mod page;
pub mod password;
pub mod problem;
pub mod time;
