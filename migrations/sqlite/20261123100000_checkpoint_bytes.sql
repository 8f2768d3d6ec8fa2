-- What a robot's task goes on from is bytes: a format number, then what that format says. Those of
-- before are JSON text, which begins with `{` and is still read.
CREATE TABLE checkpoint_bytes (
    robot INTEGER PRIMARY KEY REFERENCES robot (key),
    stamp_ns INTEGER NOT NULL,
    received_ns INTEGER NOT NULL,
    state BLOB NOT NULL
) STRICT;
INSERT INTO checkpoint_bytes (robot, stamp_ns, received_ns, state)
SELECT robot, stamp_ns, received_ns, CAST(state AS BLOB) FROM checkpoint;
DROP TABLE checkpoint;
ALTER TABLE checkpoint_bytes RENAME TO checkpoint;
