-- Alerts, who has taken them on, and what is told to whom over HTTP.

-- One thing that is or was wrong with one robot, as its JSON document; the columns beside it are
-- taken from the document by the database, so that the two cannot disagree.
CREATE TABLE alert (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    record TEXT NOT NULL CHECK (json_valid(record)),
    robot TEXT NOT NULL GENERATED ALWAYS AS (record ->> '$.robot') STORED,
    kind TEXT NOT NULL GENERATED ALWAYS AS (record ->> '$.kind') STORED,
    state TEXT NOT NULL GENERATED ALWAYS AS (record ->> '$.condition.state') STORED,
    ended_ns INTEGER GENERATED ALWAYS AS (record ->> '$.ended_ns') STORED,
    -- Place in a list, the most urgent first.
    rank INTEGER NOT NULL
) STRICT;
-- A robot has one active alert of a kind, whatever a program believes.
CREATE UNIQUE INDEX alert_active ON alert (robot, kind) WHERE state <> 'normal';
CREATE INDEX alert_rank ON alert (rank, id);
CREATE INDEX alert_robot ON alert (robot, rank, id);
CREATE INDEX alert_ended ON alert (ended_ns) WHERE ended_ns IS NOT NULL;

-- How an alert went: a row for each change of its condition, and for its acknowledgement.
CREATE TABLE alert_change (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    alert INTEGER NOT NULL REFERENCES alert (id) ON DELETE CASCADE,
    at_ns INTEGER NOT NULL,
    version INTEGER NOT NULL,
    state TEXT NOT NULL,
    what TEXT NOT NULL,
    -- Who acknowledged; NULL for a change of the condition.
    by TEXT,
    note TEXT
) STRICT;
CREATE INDEX alert_change_alert ON alert_change (alert, id);

-- Who is told. The secret is kept as it is, because every message is signed with it.
CREATE TABLE webhook (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    record TEXT NOT NULL CHECK (json_valid(record)),
    url TEXT NOT NULL GENERATED ALWAYS AS (record ->> '$.url') STORED,
    secret BLOB NOT NULL
) STRICT;
CREATE UNIQUE INDEX webhook_url ON webhook (url);

-- What is told: written in the transaction of the change itself, sent afterwards.
CREATE TABLE webhook_delivery (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    webhook INTEGER NOT NULL REFERENCES webhook (id) ON DELETE CASCADE,
    message TEXT NOT NULL,
    event TEXT NOT NULL,
    body TEXT NOT NULL CHECK (json_valid(body)),
    created_ns INTEGER NOT NULL,
    state TEXT NOT NULL CHECK (state IN ('waiting', 'delivered', 'given_up')),
    due_ns INTEGER NOT NULL,
    attempts_made INTEGER NOT NULL,
    -- The latest attempts, oldest first.
    attempts TEXT NOT NULL CHECK (json_valid(attempts)),
    finished_ns INTEGER
) STRICT;
CREATE INDEX webhook_delivery_waiting ON webhook_delivery (webhook, id) WHERE state = 'waiting';
CREATE INDEX webhook_delivery_webhook ON webhook_delivery (webhook, id);
