//! The robot's side of the wire: simulator, recordings and their replay.
