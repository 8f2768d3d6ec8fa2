-- Several instances on this database: which of them estimates which robot. A service that is alone
-- uses none of this.

-- Every lease and every span of time runs on this clock: wall time of the server, ns.
CREATE FUNCTION clock_ns() RETURNS BIGINT LANGUAGE sql VOLATILE AS $$
    SELECT (extract(epoch FROM clock_timestamp()) * 1000000000)::bigint
$$;

-- The least number in an order that a server may give out: each promotion of a standby begins a
-- timeline, so that what is numbered afterwards is behind everything that the promotion forgot.
CREATE FUNCTION order_floor() RETURNS BIGINT LANGUAGE sql VOLATILE AS $$
    SELECT ('x' || substr(pg_walfile_name(pg_current_wal_lsn()), 1, 8))::bit(32)::bigint << 40
$$;

-- Instances with their leases. To end a life, this row is locked FOR UPDATE first; who writes for
-- one locks it FOR KEY SHARE. A renewal collides with neither.
CREATE TABLE instance (
    id TEXT COLLATE "C" PRIMARY KEY,
    -- Which of its lives: goes up when one begins and when one is ended by others.
    incarnation BIGINT NOT NULL,
    lease_ends_ns BIGINT NOT NULL,
    -- When others took it for dead; NULL while it lives.
    ended_ns BIGINT,
    joined_ns BIGINT NOT NULL,
    url TEXT NOT NULL,
    capacity BIGINT NOT NULL,
    draining BOOLEAN NOT NULL DEFAULT false,
    linked BOOLEAN NOT NULL DEFAULT false,
    program TEXT NOT NULL,
    checkpoint_format BIGINT NOT NULL,
    config_sha256 BYTEA NOT NULL,
    clock_ahead_ns BIGINT NOT NULL DEFAULT 0
) WITH (fillfactor = 50);

-- Who estimates a robot: a row for each one that has a configuration.
CREATE TABLE robot_owner (
    robot BIGINT PRIMARY KEY REFERENCES robot (key),
    -- The life of an instance that has it; NULL while nobody has.
    instance TEXT COLLATE "C",
    incarnation BIGINT,
    -- Orders the tenures: only ever goes up.
    epoch BIGINT NOT NULL DEFAULT 0,
    -- Tells the latest tenure from every other, a random number.
    claim BIGINT NOT NULL DEFAULT 0,
    -- The life of an instance that is to have it next.
    heir TEXT COLLATE "C",
    heir_incarnation BIGINT,
    heir_ready_ns BIGINT,
    -- Since when nobody has it.
    free_since_ns BIGINT DEFAULT clock_ns(),
    CHECK ((instance IS NULL) = (incarnation IS NULL)),
    CHECK ((instance IS NULL) = (free_since_ns IS NOT NULL)),
    CHECK ((heir IS NULL) = (heir_incarnation IS NULL))
) WITH (fillfactor = 50);
CREATE INDEX robot_owner_instance ON robot_owner (instance);

-- What one instance does for all robots.
CREATE TABLE duty (
    name TEXT COLLATE "C" PRIMARY KEY,
    instance TEXT COLLATE "C",
    incarnation BIGINT,
    free_since_ns BIGINT DEFAULT clock_ns(),
    CHECK ((instance IS NULL) = (incarnation IS NULL)),
    CHECK ((instance IS NULL) = (free_since_ns IS NOT NULL))
);
INSERT INTO duty (name) VALUES ('alerts'), ('webhooks'), ('retention'), ('discovery');

-- How far `robot_owner` and `duty` have come: who has read them reads them again when it has
-- changed.
CREATE TABLE cluster_rows (
    id BIGINT PRIMARY KEY CHECK (id = 1),
    version BIGINT NOT NULL
) WITH (fillfactor = 50);
INSERT INTO cluster_rows (id, version) VALUES (1, 0);

CREATE FUNCTION note_cluster_rows() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    UPDATE cluster_rows SET version = greatest(version + 1, order_floor());
    RETURN NULL;
END
$$;
CREATE TRIGGER robot_owner_is_noted AFTER INSERT OR UPDATE OR DELETE ON robot_owner
    FOR EACH STATEMENT EXECUTE FUNCTION note_cluster_rows();
CREATE TRIGGER duty_is_noted AFTER INSERT OR UPDATE OR DELETE ON duty
    FOR EACH STATEMENT EXECUTE FUNCTION note_cluster_rows();

INSERT INTO robot_owner (robot) SELECT key FROM robot WHERE config IS NOT NULL;
CREATE FUNCTION add_robot_owner() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    IF NOT EXISTS (SELECT FROM robot_owner WHERE robot = NEW.key) THEN
        INSERT INTO robot_owner (robot) VALUES (NEW.key) ON CONFLICT DO NOTHING;
    END IF;
    RETURN NULL;
END
$$;
CREATE TRIGGER robot_has_owner AFTER INSERT OR UPDATE OF config ON robot
    FOR EACH ROW WHEN (NEW.config IS NOT NULL) EXECUTE FUNCTION add_robot_owner();

-- The public half of what documents are signed with, the same for all instances.
CREATE TABLE cluster_key (
    id BIGINT PRIMARY KEY CHECK (id = 1),
    signing_key TEXT NOT NULL
);

-- Its format, by which an instance sees whether it can go on from there: the first byte, and 1 of
-- the former one, which is JSON text.
ALTER TABLE checkpoint ADD COLUMN format BIGINT NOT NULL GENERATED ALWAYS AS (
    CASE
        WHEN length(state) = 0 THEN 0
        WHEN get_byte(state, 0) = ascii('{') THEN 1
        ELSE get_byte(state, 0)
    END
) STORED;
