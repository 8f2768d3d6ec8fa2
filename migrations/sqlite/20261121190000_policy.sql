-- The approval policy as it was set over the API. Without one, the configuration file's counts.
CREATE TABLE policy (
    id INTEGER PRIMARY KEY CHECK (id = 1),
    version INTEGER NOT NULL,
    policy TEXT,
    by TEXT,
    at_ns INTEGER,
    reason TEXT
) STRICT;
INSERT INTO policy (id, version) VALUES (1, 1);
