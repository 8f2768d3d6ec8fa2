-- People who sign in. Names differ by more than upper and lower case.
CREATE TABLE user (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    name TEXT NOT NULL UNIQUE COLLATE NOCASE,
    role TEXT NOT NULL CHECK (role IN ('viewer', 'operator', 'approver', 'admin')),
    -- argon2id with its parameters and salt, as a PHC string.
    password TEXT NOT NULL,
    disabled INTEGER NOT NULL DEFAULT 0 CHECK (disabled IN (0, 1)),
    -- Goes up by one with every change of name, role, password or `disabled`.
    version INTEGER NOT NULL DEFAULT 1,
    created_ns INTEGER NOT NULL,
    updated_ns INTEGER NOT NULL,
    signed_in_ns INTEGER
) STRICT;

-- Browsers that are signed in. The browser holds the secret, here is its SHA-256.
CREATE TABLE session (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    sha256 BLOB NOT NULL UNIQUE CHECK (length(sha256) = 32),
    user INTEGER NOT NULL REFERENCES user (id) ON DELETE CASCADE,
    created_ns INTEGER NOT NULL,
    used_ns INTEGER NOT NULL
) STRICT;
CREATE INDEX session_user ON session (user, id);

-- API tokens of tools and robots. The value is shown once, here is its SHA-256.
CREATE TABLE token (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    sha256 BLOB NOT NULL UNIQUE CHECK (length(sha256) = 32),
    name TEXT NOT NULL,
    role TEXT NOT NULL CHECK (role IN ('robot', 'viewer', 'operator', 'approver', 'admin')),
    -- The one robot that a token of role 'robot' is bound to.
    robot TEXT CHECK ((role = 'robot') = (robot IS NOT NULL)),
    created_by TEXT NOT NULL,
    created_ns INTEGER NOT NULL,
    expires_ns INTEGER,
    used_ns INTEGER,
    revoked_ns INTEGER
) STRICT;

-- Answers already given to requests with an `Idempotency-Key` that made a user or a token. The
-- hash is of what was asked for without the password, which must not be guessed from here.
CREATE TABLE access_idempotency (
    -- 'user' or 'token'.
    made TEXT NOT NULL,
    key TEXT NOT NULL,
    request_sha256 BLOB NOT NULL,
    id INTEGER NOT NULL,
    received_ns INTEGER NOT NULL,
    PRIMARY KEY (made, key)
) STRICT, WITHOUT ROWID;
CREATE INDEX access_idempotency_received ON access_idempotency (received_ns);
