-- Who did what, with what it was before and after. Rows are written in the transaction of the
-- change itself and are never touched again.
CREATE TABLE audit (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    at_ns INTEGER NOT NULL,
    -- Who: a person's or token's name, a robot's id, or 'fleetcal' itself.
    actor TEXT NOT NULL,
    -- How the actor proved it: 'session', 'token', 'setup_link', 'zenoh', 'service', 'command_line'.
    authentication TEXT NOT NULL,
    role TEXT,
    request TEXT,
    -- What was done, such as 'deployment.acknowledge'.
    action TEXT NOT NULL,
    -- To what, such as 'deployment' 17.
    subject TEXT NOT NULL,
    subject_id TEXT NOT NULL,
    robot TEXT,
    before TEXT CHECK (before IS NULL OR json_valid(before)),
    after TEXT CHECK (after IS NULL OR json_valid(after)),
    reason TEXT
) STRICT;
CREATE INDEX audit_robot ON audit (robot, id) WHERE robot IS NOT NULL;
CREATE INDEX audit_subject ON audit (subject, subject_id, id);

CREATE TRIGGER audit_is_never_changed BEFORE UPDATE ON audit
BEGIN SELECT RAISE(ABORT, 'an audit row is never changed'); END;
CREATE TRIGGER audit_is_never_deleted BEFORE DELETE ON audit
BEGIN SELECT RAISE(ABORT, 'an audit row is never deleted'); END;
