-- Times named `_ns` are nanoseconds since the Unix epoch; `t` and `received` are whole seconds.
-- `t`, `stamp_ns`: message time, what the robot's own stamps say. `received`, `received_ns`: the
-- service's clock, by which retention goes. Angles are in radians, lengths in metres.

-- Every robot the store knows. `config` is NULL for one that nobody has described yet.
CREATE TABLE robot (
    key INTEGER PRIMARY KEY,
    id TEXT NOT NULL UNIQUE,
    config TEXT CHECK (config IS NULL OR json_valid(config)),
    -- Goes up by one with every change of `config`; 0 while there is none.
    version INTEGER NOT NULL DEFAULT 0,
    created_ns INTEGER NOT NULL,
    updated_ns INTEGER NOT NULL
) STRICT;

-- The latest estimate of each robot as the API gives it.
CREATE TABLE robot_current (
    robot INTEGER PRIMARY KEY REFERENCES robot (key),
    stamp_ns INTEGER NOT NULL,
    received_ns INTEGER NOT NULL,
    estimate TEXT NOT NULL CHECK (json_valid(estimate))
) STRICT;

-- The estimator's state, from which a restarted service goes on.
CREATE TABLE checkpoint (
    robot INTEGER PRIMARY KEY REFERENCES robot (key),
    stamp_ns INTEGER NOT NULL,
    received_ns INTEGER NOT NULL,
    state TEXT NOT NULL CHECK (json_valid(state))
) STRICT;

-- One row a second and robot. The key begins with the time, so that a second's rows of the whole
-- fleet go into neighbouring pages. A parameter that is fixed or off is NULL.
-- `status` holds four bits a parameter, the first parameter lowest: 0 off, 1 fixed, 2 learning,
-- 3 unobservable, 4 converged.
CREATE TABLE history_second (
    t INTEGER NOT NULL,
    robot INTEGER NOT NULL REFERENCES robot (key),
    received INTEGER NOT NULL,
    steering_offset REAL, steering_offset_sigma REAL,
    lidar_x REAL, lidar_x_sigma REAL,
    lidar_y REAL, lidar_y_sigma REAL,
    lidar_yaw REAL, lidar_yaw_sigma REAL,
    speed_scale REAL, speed_scale_sigma REAL,
    wheelbase REAL, wheelbase_sigma REAL,
    time_offset REAL, time_offset_sigma REAL,
    steering_gain REAL, steering_gain_sigma REAL,
    status INTEGER NOT NULL,
    nis REAL,
    PRIMARY KEY (t, robot)
) STRICT, WITHOUT ROWID;
CREATE INDEX history_second_received ON history_second (received);

-- Roll-ups of the seconds: `_sigma` is the mean of the seconds' sigmas, `status` the last one.
-- `t` is the start of the minute or the hour; `received` that of its newest second.
CREATE TABLE history_minute (
    t INTEGER NOT NULL,
    robot INTEGER NOT NULL REFERENCES robot (key),
    received INTEGER NOT NULL,
    count INTEGER NOT NULL,
    steering_offset_mean REAL, steering_offset_min REAL, steering_offset_max REAL, steering_offset_sigma REAL,
    lidar_x_mean REAL, lidar_x_min REAL, lidar_x_max REAL, lidar_x_sigma REAL,
    lidar_y_mean REAL, lidar_y_min REAL, lidar_y_max REAL, lidar_y_sigma REAL,
    lidar_yaw_mean REAL, lidar_yaw_min REAL, lidar_yaw_max REAL, lidar_yaw_sigma REAL,
    speed_scale_mean REAL, speed_scale_min REAL, speed_scale_max REAL, speed_scale_sigma REAL,
    wheelbase_mean REAL, wheelbase_min REAL, wheelbase_max REAL, wheelbase_sigma REAL,
    time_offset_mean REAL, time_offset_min REAL, time_offset_max REAL, time_offset_sigma REAL,
    steering_gain_mean REAL, steering_gain_min REAL, steering_gain_max REAL, steering_gain_sigma REAL,
    status INTEGER NOT NULL,
    nis_mean REAL,
    nis_max REAL,
    PRIMARY KEY (t, robot)
) STRICT, WITHOUT ROWID;
CREATE INDEX history_minute_received ON history_minute (received);

CREATE TABLE history_hour (
    t INTEGER NOT NULL,
    robot INTEGER NOT NULL REFERENCES robot (key),
    received INTEGER NOT NULL,
    count INTEGER NOT NULL,
    steering_offset_mean REAL, steering_offset_min REAL, steering_offset_max REAL, steering_offset_sigma REAL,
    lidar_x_mean REAL, lidar_x_min REAL, lidar_x_max REAL, lidar_x_sigma REAL,
    lidar_y_mean REAL, lidar_y_min REAL, lidar_y_max REAL, lidar_y_sigma REAL,
    lidar_yaw_mean REAL, lidar_yaw_min REAL, lidar_yaw_max REAL, lidar_yaw_sigma REAL,
    speed_scale_mean REAL, speed_scale_min REAL, speed_scale_max REAL, speed_scale_sigma REAL,
    wheelbase_mean REAL, wheelbase_min REAL, wheelbase_max REAL, wheelbase_sigma REAL,
    time_offset_mean REAL, time_offset_min REAL, time_offset_max REAL, time_offset_sigma REAL,
    steering_gain_mean REAL, steering_gain_min REAL, steering_gain_max REAL, steering_gain_sigma REAL,
    status INTEGER NOT NULL,
    nis_mean REAL,
    nis_max REAL,
    PRIMARY KEY (t, robot)
) STRICT, WITHOUT ROWID;
CREATE INDEX history_hour_received ON history_hour (received);

-- What happened to a robot: changes the estimator found, notes of people, sessions, restarts.
CREATE TABLE robot_event (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    robot INTEGER NOT NULL REFERENCES robot (key),
    kind TEXT NOT NULL,
    stamp_ns INTEGER NOT NULL,
    received_ns INTEGER NOT NULL,
    -- Who says so: 'estimator', 'robot', 'service' or 'person'.
    source TEXT NOT NULL,
    author TEXT,
    note TEXT,
    details TEXT CHECK (details IS NULL OR json_valid(details))
) STRICT;
CREATE INDEX robot_event_robot ON robot_event (robot, id);
CREATE INDEX robot_event_stamp ON robot_event (robot, stamp_ns);
CREATE INDEX robot_event_received ON robot_event (received_ns);

-- Answers already given to requests with an `Idempotency-Key`.
CREATE TABLE idempotency (
    scope TEXT NOT NULL,
    key TEXT NOT NULL,
    request_sha256 BLOB NOT NULL,
    event INTEGER NOT NULL REFERENCES robot_event (id) ON DELETE CASCADE,
    received INTEGER NOT NULL,
    PRIMARY KEY (scope, key)
) STRICT, WITHOUT ROWID;
CREATE INDEX idempotency_received ON idempotency (received);
CREATE INDEX idempotency_event ON idempotency (event);

-- Written to find out whether the database can be written.
CREATE TABLE probe (
    id INTEGER PRIMARY KEY CHECK (id = 1),
    written_ns INTEGER NOT NULL
) STRICT;
INSERT INTO probe (id, written_ns) VALUES (1, 0);
