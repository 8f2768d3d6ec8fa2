//! A deterministic simulator of a wheeled robot with a rolling 2D LiDAR in a warehouse.
