-- The stream of measured speed and steering was called `drive` and is called `wheel_odometry`.

-- Whether it is the sensor's steering angle, raw.
UPDATE robot SET config = json_remove(
    json_set(config, '$.wheel_odometry', config ->> '$.drive'), '$.drive'
)
WHERE config ->> '$.drive' IS NOT NULL;

-- A robot whose topic was named keeps it.
UPDATE robot SET config = json_remove(
    json_set(config, '$.streams.wheel_odometry', json(config -> '$.streams.drive')),
    '$.streams.drive'
)
WHERE config -> '$.streams.drive' IS NOT NULL;

-- Others keep the topic that was the usual one, unless `fleetcal.toml` names another.
UPDATE robot SET config = json_set(
    json_set(config, '$.streams', json(coalesce(config -> '$.streams', '{}'))),
    '$.streams.former_topic', json('true')
)
WHERE config IS NOT NULL
    AND config -> '$.streams.wheel_odometry' IS NULL
    AND config -> '$.streams.steering' IS NULL
    AND config -> '$.streams.speed' IS NULL;
