-- Certificates of verified calibrations, signed: written in the transaction that verifies the
-- deployment, byte for byte, and deleted for their age alone.
CREATE TABLE certificate (
    number BIGINT PRIMARY KEY REFERENCES deployment (id),
    robot TEXT COLLATE "C" NOT NULL,
    verified_ns BIGINT NOT NULL,
    -- Who approved, as the deployment names them.
    approved_by TEXT NOT NULL,
    record TEXT NOT NULL CHECK (record::json IS NOT NULL)
);
CREATE INDEX certificate_robot ON certificate (robot, number);
CREATE INDEX certificate_verified ON certificate (verified_ns);
CREATE TRIGGER certificate_is_never_changed BEFORE UPDATE ON certificate
    FOR EACH ROW EXECUTE FUNCTION refuse_change();
INSERT INTO schema_compatible (version, oldest) VALUES (20261128120000, 20261124160000);
