-- Roll-backs that people made before a record said so (`chosen_by`): the service does not replace
-- these values either. Who asked stands in the deployment itself, or in the audit.

-- A return while nothing else was under way: only people ask for one.
UPDATE deployment SET record = json_set(record, '$.offer.chosen_by', record ->> '$.approved_by')
WHERE proposal IS NULL
    AND record ->> '$.offer.chosen_by' IS NULL
    AND record ->> '$.approved_by' <> 'fleetcal';

-- A deployment under way that somebody rolled back: the first roll-back brought the former values.
UPDATE deployment SET record = json_set(
    record,
    '$.offer.chosen_by',
    (SELECT audit.actor FROM audit
     WHERE audit.subject = 'deployment' AND audit.subject_id = CAST(deployment.id AS TEXT)
         AND audit.action = 'deployment.roll_back'
     ORDER BY audit.id DESC LIMIT 1)
)
WHERE proposal IS NOT NULL
    AND json_array_length(record, '$.earlier') > 0
    AND record ->> '$.offer.chosen_by' IS NULL
    AND 'service' <> (
        SELECT audit.authentication FROM audit
        WHERE audit.subject = 'deployment' AND audit.subject_id = CAST(deployment.id AS TEXT)
            AND audit.action = 'deployment.roll_back'
        ORDER BY audit.id DESC LIMIT 1
    );

-- What a robot should hold is one of these documents.
UPDATE shadow SET record = json_set(
    record,
    '$.desired.chosen_by',
    (SELECT deployment.record ->> '$.offer.chosen_by' FROM deployment
     WHERE deployment.robot = shadow.robot
         AND deployment.record ->> '$.offer.generation' = shadow.record ->> '$.desired.generation'
     ORDER BY deployment.id DESC LIMIT 1)
)
WHERE record ->> '$.desired.chosen_by' IS NULL
    AND EXISTS (
        SELECT 1 FROM deployment
        WHERE deployment.robot = shadow.robot
            AND deployment.record ->> '$.offer.generation' = shadow.record ->> '$.desired.generation'
            AND deployment.record ->> '$.offer.chosen_by' IS NOT NULL
    );
