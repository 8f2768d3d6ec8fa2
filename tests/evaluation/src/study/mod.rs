//! The studies, each a section of the report.

pub mod cases;
pub mod convergence;
pub mod induced;
pub mod second_platform;
