//! End-to-end tests: real processes, real Zenoh, real recordings. One binary, since each links all of
//! Zenoh and SQLite; a folder below is a module, and a test is called by `service::…`, `zenoh::…`.

mod agent;
mod calibrate;
mod durability;
mod http;
mod lidar_odometry;
mod load;
mod plain_robots;
mod recordings;
mod service;
mod zenoh;
