-- Certificates of verified calibrations, signed: written in the transaction that verifies the
-- deployment, byte for byte, and deleted for their age alone.
CREATE TABLE certificate (
    number INTEGER PRIMARY KEY REFERENCES deployment (id),
    robot TEXT NOT NULL,
    verified_ns INTEGER NOT NULL,
    -- Who approved, as the deployment names them.
    approved_by TEXT NOT NULL,
    record TEXT NOT NULL CHECK (json_valid(record))
) STRICT;
CREATE INDEX certificate_robot ON certificate (robot, number);
CREATE INDEX certificate_verified ON certificate (verified_ns);
CREATE TRIGGER certificate_is_never_changed BEFORE UPDATE ON certificate
BEGIN SELECT RAISE(ABORT, 'a certificate is never changed'); END;
