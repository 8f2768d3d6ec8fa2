-- Tries to sign in over all instances of a cluster: when those of a key are worked off. They need not
-- outlive the server.
CREATE UNLOGGED TABLE sign_in_try (
    key TEXT COLLATE "C" PRIMARY KEY,
    worked_off_ns BIGINT NOT NULL
);
CREATE INDEX sign_in_try_worked_off ON sign_in_try (worked_off_ns);
INSERT INTO schema_compatible (version, oldest) VALUES (20261124170000, 20261124160000);
