-- The records of the life cycle, each as its JSON document; the columns beside it are taken from
-- the document by the database, so that the two cannot disagree.

CREATE TABLE revision (
    id INTEGER PRIMARY KEY,
    record TEXT NOT NULL CHECK (json_valid(record)),
    robot TEXT NOT NULL GENERATED ALWAYS AS (record ->> '$.robot') STORED
) STRICT;
CREATE INDEX revision_robot ON revision (robot, id);
CREATE TRIGGER revision_is_never_changed BEFORE UPDATE ON revision
BEGIN SELECT RAISE(ABORT, 'a revision is never changed'); END;
CREATE TRIGGER revision_is_never_deleted BEFORE DELETE ON revision
BEGIN SELECT RAISE(ABORT, 'a revision is never deleted'); END;

CREATE TABLE proposal (
    id INTEGER PRIMARY KEY,
    record TEXT NOT NULL CHECK (json_valid(record)),
    robot TEXT NOT NULL GENERATED ALWAYS AS (record ->> '$.robot') STORED,
    state TEXT NOT NULL GENERATED ALWAYS AS (record ->> '$.state') STORED,
    revision INTEGER NOT NULL GENERATED ALWAYS AS (record ->> '$.revision') STORED
        REFERENCES revision (id)
) STRICT;
CREATE UNIQUE INDEX proposal_open ON proposal (robot) WHERE state = 'proposed';
CREATE INDEX proposal_robot ON proposal (robot, id);
CREATE INDEX proposal_state ON proposal (state, id);

CREATE TABLE deployment (
    id INTEGER PRIMARY KEY,
    record TEXT NOT NULL CHECK (json_valid(record)),
    robot TEXT NOT NULL GENERATED ALWAYS AS (record ->> '$.robot') STORED,
    state TEXT NOT NULL GENERATED ALWAYS AS (record ->> '$.state') STORED,
    proposal INTEGER GENERATED ALWAYS AS (record ->> '$.proposal') STORED
        REFERENCES proposal (id)
) STRICT;
-- A robot has one deployment under way, whatever a program believes.
CREATE UNIQUE INDEX deployment_live ON deployment (robot)
    WHERE state IN ('queued', 'offered', 'applied', 'verifying', 'rolling_back');
CREATE INDEX deployment_robot ON deployment (robot, id);
CREATE INDEX deployment_proposal ON deployment (proposal) WHERE proposal IS NOT NULL;

CREATE TABLE shadow (
    robot TEXT PRIMARY KEY,
    record TEXT NOT NULL CHECK (json_valid(record))
) STRICT, WITHOUT ROWID;

-- Signed documents, byte for byte.
CREATE TABLE envelope (
    robot TEXT NOT NULL,
    generation INTEGER NOT NULL,
    record TEXT NOT NULL CHECK (json_valid(record)),
    PRIMARY KEY (robot, generation)
) STRICT, WITHOUT ROWID;
CREATE TRIGGER envelope_is_never_changed BEFORE UPDATE ON envelope
BEGIN SELECT RAISE(ABORT, 'a signed document is never changed'); END;

-- What was decided and is not yet on the wire. A newer one of its kind takes the place of an
-- older one.
CREATE TABLE outbox (
    robot TEXT NOT NULL,
    kind TEXT NOT NULL CHECK (kind IN ('approved', 'confirmed')),
    generation INTEGER NOT NULL,
    PRIMARY KEY (robot, kind)
) STRICT, WITHOUT ROWID;

-- Answers already given to proposals with an `Idempotency-Key`.
CREATE TABLE proposal_request (
    robot TEXT NOT NULL,
    key TEXT NOT NULL,
    request_sha256 BLOB NOT NULL,
    proposal INTEGER NOT NULL REFERENCES proposal (id),
    received INTEGER NOT NULL,
    PRIMARY KEY (robot, key)
) STRICT, WITHOUT ROWID;
CREATE INDEX proposal_request_received ON proposal_request (received);

-- The site-wide stop: while it is held, nothing is offered that robots have not seen yet.
CREATE TABLE site (
    id INTEGER PRIMARY KEY CHECK (id = 1),
    version INTEGER NOT NULL,
    held INTEGER NOT NULL CHECK (held IN (0, 1)),
    by TEXT,
    at_ns INTEGER,
    reason TEXT
) STRICT;
INSERT INTO site (id, version, held) VALUES (1, 1, 0);
