-- How well a robot follows its path, as it says itself, with each calibration that it has used.
-- Generation 0 is what it drove with before any was applied.
CREATE TABLE cross_track (
    robot TEXT NOT NULL,
    generation INTEGER NOT NULL,
    errors TEXT NOT NULL CHECK (json_valid(errors)),
    PRIMARY KEY (robot, generation)
) STRICT, WITHOUT ROWID;
