-- Who gave the drawing in `config`, from which the size of a first calibration is measured; NULL
-- where the configuration file did.
ALTER TABLE robot ADD COLUMN drawn_by TEXT;

-- Of what is configured already, whoever configured it last.
UPDATE robot SET drawn_by = (
    SELECT CASE audit.authentication WHEN 'service' THEN NULL ELSE audit.actor END
    FROM audit
    WHERE audit.subject = 'robot' AND audit.subject_id = robot.id
    ORDER BY audit.id DESC LIMIT 1
)
WHERE config IS NOT NULL;
INSERT INTO schema_compatible (version, oldest) VALUES (20261128100000, 20261124160000);
