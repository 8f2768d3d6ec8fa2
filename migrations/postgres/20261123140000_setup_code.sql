-- Codes by which the first administrator is made, until there is one. The link that a start without
-- users prints holds the code, here is its SHA-256.
CREATE TABLE setup_code (
    sha256 BYTEA PRIMARY KEY CHECK (length(sha256) = 32),
    ends_ns BIGINT NOT NULL
);
