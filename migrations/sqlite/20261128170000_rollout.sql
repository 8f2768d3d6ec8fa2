-- Staged deployments: a roll-out, and what was approved for each of its robots, which never
-- changes. The stage of a robot follows from its proposal and deployment.
CREATE TABLE rollout (
    id INTEGER PRIMARY KEY,
    record TEXT NOT NULL CHECK (json_valid(record)),
    state TEXT NOT NULL GENERATED ALWAYS AS (record ->> '$.state') STORED
) STRICT;
CREATE INDEX rollout_state ON rollout (state, id);

CREATE TABLE rollout_robot (
    rollout INTEGER NOT NULL REFERENCES rollout (id),
    robot TEXT NOT NULL,
    -- Number of the wave, from 1.
    wave INTEGER NOT NULL,
    proposal INTEGER NOT NULL REFERENCES proposal (id),
    -- A proposal with another one by now is not what was approved.
    revision INTEGER NOT NULL REFERENCES revision (id),
    PRIMARY KEY (rollout, robot)
) STRICT, WITHOUT ROWID;
CREATE TRIGGER rollout_robot_is_never_changed BEFORE UPDATE ON rollout_robot
BEGIN SELECT RAISE(ABORT, 'what was approved is never changed'); END;
