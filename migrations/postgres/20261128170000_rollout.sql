-- Staged deployments: a roll-out, and what was approved for each of its robots, which never
-- changes. The stage of a robot follows from its proposal and deployment.
CREATE TABLE rollout (
    id BIGINT PRIMARY KEY,
    record TEXT NOT NULL CHECK (record::json IS NOT NULL),
    state TEXT NOT NULL GENERATED ALWAYS AS (record::json ->> 'state') STORED
);
CREATE INDEX rollout_state ON rollout (state, id);

CREATE TABLE rollout_robot (
    rollout BIGINT NOT NULL REFERENCES rollout (id),
    robot TEXT COLLATE "C" NOT NULL,
    -- Number of the wave, from 1.
    wave BIGINT NOT NULL,
    proposal BIGINT NOT NULL REFERENCES proposal (id),
    -- A proposal with another one by now is not what was approved.
    revision BIGINT NOT NULL REFERENCES revision (id),
    PRIMARY KEY (rollout, robot)
);
CREATE TRIGGER rollout_robot_is_never_changed BEFORE UPDATE ON rollout_robot
    FOR EACH ROW EXECUTE FUNCTION refuse_change();
-- An older program cannot read deliveries of the event rollout.halted, and would deliver nothing.
INSERT INTO schema_compatible (version, oldest) VALUES (20261128170000, 20261128170000);
