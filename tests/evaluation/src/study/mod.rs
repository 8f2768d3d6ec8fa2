//! The studies, each a section of the report.

pub mod beside_paper;
pub mod cases;
pub mod closed_loop;
pub mod convergence;
pub mod cross_track;
pub mod extrinsics;
pub mod first_choice;
pub mod imperfect_robots;
pub mod induced;
pub mod observability;
pub mod odometry;
pub mod recording;
pub mod refinement;
pub mod second_platform;
