//! Every limit of the service: queues, caches, bodies, waits. One name each, all in one place.

mod bulk;
mod moments;
mod preview;
mod support;
mod zenoh;

use std::time::Duration;

use fleetcal_model::Stream;

pub use bulk::*;
pub use moments::*;
pub use preview::*;
pub use support::*;
pub use zenoh::*;

/// Largest message that the Zenoh transport assembles, in bytes: the largest payload, its key and
/// its attachment. A session can leave one unfinished on its reliable and one on its other channel.
pub const ZENOH_MESSAGE_BYTES_MAX: usize = payload_bytes_max(Stream::Scan) + 64 * 1024;

/// Largest accepted payload of a robot on one stream, in bytes. A full mailbox of the largest ones
/// stays under 36 MiB; the largest scan is a cloud of 32,768 points of 48 bytes and some more.
pub const fn payload_bytes_max(stream: Stream) -> usize {
    match stream {
        Stream::Scan => 2 * 1024 * 1024,
        Stream::LidarOdometry => 64 * 1024,
        // A hundred joints with all their interfaces, of an arm on the robot too.
        Stream::WheelOdometry | Stream::Steering | Stream::Speed | Stream::Event => 16 * 1024,
    }
}

/// Drive samples that wait in a robot's mailbox.
pub const MAILBOX_WHEEL_ODOMETRY_MAX: usize = 1_024;
/// Scans (or LiDAR poses) that wait in a robot's mailbox.
pub const MAILBOX_SCANS_MAX: usize = 8;
/// Notes and other rare messages that wait in a robot's mailbox.
pub const MAILBOX_NOTES_MAX: usize = 64;
/// Stored notes about a robot that are read at once for its estimator.
pub const NOTES_BROUGHT_MAX: u32 = 64;
/// Longest wait of a drive sample for the next scan, with which it is processed: waking the task for
/// each message would cost more than the message. All robots have their rounds at the same moments.
pub const TASK_ROUND: Duration = Duration::from_millis(100);
/// Rounds without a message after which a robot's task waits for the next one.
pub const TASK_IDLE_ROUNDS: u32 = 5;
/// Messages of wheel odometry that wait until the next round; further ones are processed at once.
pub const TASK_ROUND_WHEEL_ODOMETRY_MAX: usize = 64;
/// Robots that are configured.
pub const ROBOTS_MAX: usize = 4_096;
/// Robots that send without being configured; further ones are counted and forgotten.
pub const UNREGISTERED_ROBOTS_MAX: usize = 256;
/// Live updates that a slow listener may lag behind before it loses the oldest.
pub const LIVE_UPDATES_MAX: usize = 4_096;
/// Characters of a note that a person or tool attaches.
pub const NOTE_CHARS_MAX: usize = 1_000;
/// Characters of a query for robots.
pub const VIEW_QUERY_CHARS_MAX: usize = 2_000;
/// Conditions of a query for robots.
pub const VIEW_QUERY_TERMS_MAX: usize = 50;
/// Characters of a refusal's reason that are kept for the robot's page.
pub const REFUSAL_CHARS_MAX: usize = 300;

/// ROS 2 topics that a robot can have announced; further ones are left out.
pub const ANNOUNCED_TOPICS_MAX: usize = 256;
/// ROS 2 tokens that are remembered at once; further ones are left out.
pub const ROS2_TOKENS_MAX: usize = 16_384;

/// ROS 2 tokens of one robot, which has some for each topic that it publishes or subscribes to.
pub const ROS2_TOKENS_OF_ROBOT_MAX: usize = 1_024;
/// Longest ROS 2 token that is read.
pub const ROS2_TOKEN_BYTES_MAX: usize = 1_024;
/// Largest `robot_description` of a ROS 2 robot that is kept, bytes; most have 20 to 200 kB.
pub const ROBOT_DESCRIPTION_BYTES_MAX: usize = 1 << 20;
/// Largest message of `tf_static` that is kept, bytes.
pub const TF_STATIC_BYTES_MAX: usize = 64 << 10;
/// Messages of `tf_static` that are kept of one robot, the latest: each node publishes its own.
pub const TF_STATIC_MESSAGES_MAX: usize = 16;
/// Bytes of all robots' descriptions together; further ones are refused.
pub const DESCRIPTIONS_BYTES_MAX: usize = 64 << 20;
/// Bytes beyond which no further description of an unregistered robot is kept: strangers leave room
/// for the registered ones.
pub const DESCRIPTIONS_OF_UNREGISTERED_BYTES_MAX: usize = 16 << 20;
/// Announced descriptions that wait to be queried; further ones are left out.
pub const DESCRIPTIONS_ASKED_MAX: usize = 256;

/// Places, of a prefix and a key layout, that one robot's ROS 2 topics can have at once.
pub const ROS2_HOMES_MAX: usize = 4;

/// Time for which a robot has a warning after its last message on a former key of a stream.
pub const FORMER_KEY_WARNED_FOR: Duration = Duration::from_secs(30);

/// Acknowledgements of one robot that wait to be stored; a further one pushes the oldest out.
pub const ANSWERS_OF_ROBOT_MAX: usize = 4;
/// New acknowledgements of one robot that are stored, an hour. Those of the deployment in progress
/// are stored besides.
pub const ANSWERS_PER_HOUR_MAX: u32 = 20;
/// Acknowledgements of one robot that are examined, an hour: an agent repeats one every five
/// seconds.
pub const ANSWERS_HEARD_PER_HOUR_MAX: u32 = 3_600;
/// Notes that one robot adds to its history, an hour; those of people are not counted.
pub const NOTES_PER_HOUR_MAX: u32 = 20;
/// Bytes of text in a robot's notes, an hour.
pub const NOTE_BYTES_PER_HOUR_MAX: u32 = 8 * 1024;
/// Events that a robot's estimator adds to its history, an hour.
pub const EVENTS_PER_HOUR_MAX: u32 = 60;
/// Interval at which losses of one kind and robot are logged.
pub const LOSSES_LOGGED_EVERY: Duration = Duration::from_mins(1);
/// Losses of all robots that are logged in that interval.
pub const LOSSES_LOGGED_MAX: usize = 60;
/// Latest innovations of a robot that are kept in memory, one of each second of driving: ten minutes,
/// in 19 kB.
pub const INNOVATIONS_KEPT: usize = 600;
/// Longest message with a robot's cross-track error, in bytes.
pub const CROSS_TRACK_BYTES_MAX: usize = 1_024;
/// Longest acknowledgement of a robot, in bytes.
pub const ANSWER_BYTES_MAX: usize = 16 * 1024;
/// Robots' queries that the database answers at once or that wait for it: one of each robot.
/// Further ones are dropped. An agent repeats its query; a ROS 2 node receives the next approval.
pub const QUESTIONS_MAX: usize = ROBOTS_MAX;
/// Wait after which unsent messages are sent again.
pub const POST_RETRY: Duration = Duration::from_secs(5);
/// Longest interval between two passes over the outbox.
pub const POST_EVERY: Duration = Duration::from_secs(30);

/// Sightings of alerts in one transaction; the rest follows a second later.
pub const ALERTS_AT_ONCE_MAX: usize = 1_000;
/// Latest changes of one alert that are remembered.
pub const ALERT_CHANGES_MAX: u32 = 500;
/// Time for which alerts are kept after their end.
pub const ALERTS_KEPT: Duration = Duration::from_hours(365 * 24);

/// Webhooks in total.
pub const WEBHOOKS_MAX: usize = 16;
/// Longest address of a webhook, in bytes.
pub const WEBHOOK_URL_BYTES_MAX: usize = 2_000;
/// Messages that wait for one receiver; beyond, the oldest is abandoned.
pub const WEBHOOK_WAITING_MAX: u32 = 1_000;
/// Latest messages of one webhook that are kept after they were accepted or abandoned.
pub const WEBHOOK_LOG_MAX: u32 = 1_000;
/// Latest attempts of one message that are kept.
pub const WEBHOOK_ATTEMPTS_KEPT: usize = 20;
/// Interval of the search for due messages.
pub const WEBHOOK_LOOK_EVERY: Duration = Duration::from_secs(1);
/// Time within which a receiver must accept the connection.
pub const WEBHOOK_CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// Time within which a receiver must have answered.
pub const WEBHOOK_TIMEOUT: Duration = Duration::from_secs(10);
/// Bytes of the header of a receiver's answer; its body is not read.
pub const WEBHOOK_ANSWER_BYTES_MAX: usize = 16 * 1024;
/// Characters of an attempt's error that are kept.
pub const WEBHOOK_ERROR_CHARS_MAX: usize = 300;
/// Wait after the first failed attempt; it doubles with each.
pub const WEBHOOK_BACKOFF_FIRST: Duration = Duration::from_secs(5);
/// Longest wait between two attempts.
pub const WEBHOOK_BACKOFF_MAX: Duration = Duration::from_hours(1);
/// Time after which an unaccepted message is abandoned.
pub const WEBHOOK_RETRY_FOR: Duration = Duration::from_hours(24);

/// Time without data after which a robot is stale.
pub const STALE_AFTER: Duration = Duration::from_secs(3);
/// Time without data after which a robot's session ends.
pub const SESSION_ENDS_AFTER: Duration = Duration::from_secs(10);
/// Time after the loss of its liveliness token at which a robot's session ends, if no more data
/// come.
pub const SESSION_ENDS_AFTER_TOKEN: Duration = Duration::from_millis(500);
/// Message time between two checkpoints of a robot that learns, verifies or has a candidate, and at most
/// that of every robot of a cluster, s.
pub const CHECKPOINT_EVERY_S: f64 = 10.0;
/// Message time between two checkpoints of a cluster's robot that has just begun, s.
pub const CHECKPOINT_OF_CLUSTER_MIN_S: f64 = 5.0;
/// Message time between two checkpoints of a cluster's robot as a share of its session: a takeover
/// loses no more than this share of the learnt data, and the seconds of the takeover itself.
pub const CHECKPOINT_OF_CLUSTER_SHARE: f64 = 0.05;
/// Message time between two checkpoints of a calibrated robot of a service that is alone, s.
pub const CHECKPOINT_CALIBRATED_EVERY_S: f64 = 60.0;
/// Bytes of a checkpoint once it is decompressed; those of a robot that verifies are some 50 KiB.
pub const CHECKPOINT_BYTES_MAX: usize = 1024 * 1024;
/// Message time by which a robot's messages may overtake each other, s: a verification run begins
/// this long after the first message that came after the robot's acknowledgement.
pub const IN_FLIGHT_S: f64 = 1.0;

/// Message time between two rankings of a robot's next manoeuvres, s.
pub const ADVICE_EVERY_S: f64 = 5.0;
/// Shortest time between two reports of a robot's joining checks, s of arrival.
pub const CHECKS_SHOWN_EVERY_S: f64 = 1.0;
/// Requests for a robot's top view that wait; later ones are answered with an advice to retry.
pub const TOP_VIEW_ASKERS_MAX: usize = 64;
/// Message time for which repeated requests get the same view, s.
pub const TOP_VIEW_EVERY_S: f64 = 0.4;
/// Distance from the LiDAR up to which a top view shows surfaces, m.
pub const TOP_VIEW_REACH_M: f64 = 30.0;
/// Nearest points of surfaces in a top view.
pub const TOP_VIEW_SURFACES_MAX: usize = 4_096;
/// Length of a top view's trajectories, m by the wheels.
pub const TOP_VIEW_TRAJECTORY_M: f64 = 20.0;
/// Points of each trajectory in a top view.
pub const TOP_VIEW_TRAJECTORY_POINTS_MAX: usize = 200;
/// Restarts of an estimator after panics, beyond which it stays stopped.
pub const ESTIMATOR_RESTARTS_MAX: u32 = 10;

/// Rows of telemetry that wait for the store.
pub const STORE_QUEUE_MAX: usize = 16_384;
/// Longest interval between two commits of telemetry.
pub const STORE_FLUSH_EVERY: Duration = Duration::from_secs(1);
/// Seconds of history that are gathered before they are written early.
pub const STORE_BATCH_MAX: usize = 4_096;
/// Rows of telemetry in one transaction: a job waits for at most one such transaction, some 30 ms.
pub const STORE_TELEMETRY_ROWS_MAX: usize = 256;
/// Jobs that wait for the store.
pub const STORE_JOBS_MAX: usize = 1_024;
/// Jobs in one transaction.
pub const STORE_JOBS_AT_ONCE_MAX: usize = 128;
/// Least interval between two writes of a robot's latest estimate; its history is stored every
/// second.
pub const STORE_CURRENT_EVERY: Duration = Duration::from_secs(10);
/// Least interval for a robot that learns no parameter, as with its checkpoints.
pub const STORE_CURRENT_LEARNT_EVERY: Duration = Duration::from_mins(1);
/// Connections that read the database.
pub const STORE_READERS_MAX: u32 = 4;
/// Wait of a reader for a connection, and of a writer for a place in the queue.
pub const STORE_READ_TIMEOUT: Duration = Duration::from_secs(5);
/// Wait of a write for another process that has locked the database. Two such waits and the pause
/// between them fit into [`STORE_ANSWER_WITHIN`].
pub const STORE_BUSY_TIMEOUT: Duration = Duration::from_millis(1_500);
/// Age from which a queued write is refused, since its caller has had an error already.
pub const STORE_ANSWER_WITHIN: Duration = Duration::from_secs(4);
/// Interval at which the writer's progress is checked.
pub const STORE_LOOK_EVERY: Duration = Duration::from_secs(5);
/// Time without a write after which the writer counts as stuck, although the database accepts
/// writes.
pub const STORE_STUCK_AFTER: Duration = Duration::from_mins(1);
/// Time within which a PostgreSQL server is connected, and left by another service, or else not
/// used.
pub const POSTGRES_CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// Wait for one of several hosts, after which the next one is tried.
pub const POSTGRES_NEXT_HOST_AFTER: Duration = Duration::from_millis(250);
/// Time limit of a statement on PostgreSQL, beyond which its connection is dropped.
pub const POSTGRES_STATEMENT_TIMEOUT: Duration = Duration::from_secs(3);
/// Time limit of a statement that reads, which may return all robots' states.
pub const POSTGRES_READ_TIMEOUT: Duration = Duration::from_secs(10);
/// Time limit of all migrations, which another process may be running, and of copied rows.
pub const POSTGRES_BULK_TIMEOUT: Duration = Duration::from_mins(10);
/// Time within which seconds of history are rolled up into minutes and hours in PostgreSQL.
pub const POSTGRES_ROLL_UP_EVERY: Duration = Duration::from_mins(1);
/// Minutes that may wait for a roll-up; more are rolled up at once.
pub const POSTGRES_ROLL_UP_WAITING_MAX: usize = 20_000;
/// Minutes that are rolled up in one transaction.
pub const POSTGRES_ROLL_UP_MAX: usize = 512;
/// Days whose partitions are known to exist.
pub const POSTGRES_DAYS_KNOWN_MAX: usize = 16;
/// Runs of a job that PostgreSQL could not serialize with others.
pub const POSTGRES_CONFLICT_TRIES: u32 = 12;
/// Pause between two such runs.
pub const POSTGRES_CONFLICT_PAUSE: Duration = Duration::from_millis(20);
/// Pause after a failed commit; each further failure doubles it.
pub const STORE_RETRY_FIRST: Duration = Duration::from_millis(100);
/// Longest pause between two commits while the database fails.
pub const STORE_RETRY_MAX: Duration = Duration::from_secs(1);
/// Attempts at a commit when the store is closed, before the remaining rows are lost.
pub const STORE_CLOSE_TRIES: u32 = 4;
/// Time for which seconds of history are kept after their receipt.
pub const HISTORY_SECONDS_KEPT: Duration = Duration::from_hours(3 * 24);
/// Time for which minutes of history are kept after their receipt.
pub const HISTORY_MINUTES_KEPT: Duration = Duration::from_hours(90 * 24);
/// Time for which hours of history, and events, are kept after their receipt.
pub const HISTORY_HOURS_KEPT: Duration = Duration::from_hours(5 * 365 * 24);
/// Time for which certificates are kept after the verification: five years and their leap days.
pub const CERTIFICATES_KEPT: Duration = Duration::from_hours((5 * 365 + 2) * 24);
/// Time for which answers to requests with an `Idempotency-Key` are kept.
pub const IDEMPOTENCY_KEPT: Duration = Duration::from_hours(24);
/// Old rows of one kind that are deleted at a time, once a second.
pub const RETENTION_ROWS_MAX: u32 = 2_000;
/// Lead of the wall clock over running time from which it counts as set rather than drifted, s.
pub const CLOCK_STEP_S: i64 = 3_600;
/// Time after which retention trusts a clock that was set forward.
pub const CLOCK_STEP_BELIEVED_AFTER: Duration = Duration::from_hours(24);
/// Rows of one tier of the history that one request reads.
pub const HISTORY_ROWS_MAX: i64 = 4 * 3_600;

/// Longest body of an HTTP request, in bytes.
pub const HTTP_BODY_BYTES_MAX: usize = 64 * 1024;
/// HTTP connections served at once. A further one, from an address without connections that wait
/// for their peer, replaces one of the address with the most that wait.
pub const HTTP_CONNECTIONS_MAX: usize = 512;
/// Wait for its peer from which a connection may be cut for another one of its address, when the
/// address has as many as it may have.
pub const HTTP_EVICTED_AFTER: Duration = Duration::from_secs(1);
/// Bytes of responses that the system holds for a slow reader; Linux uses twice as much, for its
/// own bookkeeping.
pub const HTTP_SEND_BUFFER_BYTES: u32 = 256 * 1024;
/// HTTP connections that wait to be accepted; the system may have a lower limit.
pub const HTTP_BACKLOG: u32 = 4_096;
/// HTTP connections of one address (IPv6: of one /64 network), except trusted proxies.
pub const HTTP_CONNECTIONS_PER_ADDRESS_MAX: usize = 64;
/// HTTP requests in progress at once; the connections beyond that are left to probes.
pub const HTTP_REQUESTS_MAX: usize = HTTP_CONNECTIONS_MAX - 32;
/// HTTP requests in progress from one address, also of a client behind a trusted proxy.
pub const HTTP_REQUESTS_PER_ADDRESS_MAX: usize = 64;
/// Time within which a client must have sent its request's header.
pub const HTTP_HEADER_TIMEOUT: Duration = Duration::from_secs(10);
/// Time within which a request's body must have come; a little longer than
/// [`HTTP_REQUEST_TIMEOUT`], by which its route has answered.
pub const HTTP_BODY_TIMEOUT: Duration = Duration::from_secs(12);
/// Time within which a client must read some of a response; the recording of a robot has
/// [`RECORDING_STALLED_AFTER`].
pub const HTTP_WRITE_STALL_TIMEOUT: Duration = Duration::from_secs(10);
/// Total wait of the service for a client, until that has sent a request and begun to read the
/// response: for header, body and a first stall together, each of which has its own limit besides.
pub const HTTP_PEER_TIMEOUT: Duration = Duration::from_secs(14);
/// Time within which a request is answered (event streams excepted).
pub const HTTP_REQUEST_TIMEOUT: Duration = Duration::from_secs(10);
/// Listeners of the event stream at once.
pub const HTTP_STREAMS_MAX: usize = 64;
/// Listeners of the event stream for one user or token.
pub const HTTP_STREAMS_PER_CALLER_MAX: usize = 8;
/// Listeners of the event stream at one address.
pub const HTTP_STREAMS_PER_ADDRESS_MAX: usize = 32;
/// Interval at which the fleet's lean rows are published.
pub const HTTP_STREAM_ROWS_EVERY: Duration = Duration::from_secs(1);
/// Topics of one event stream: a page shows one robot, or a few beside each other.
pub const HTTP_STREAM_TOPICS_MAX: usize = 8;
/// Silence after which an event stream sends a sign of life.
pub const HTTP_STREAM_KEEP_ALIVE: Duration = Duration::from_secs(10);
/// Wait after which a listener reconnects to a broken event stream.
pub const HTTP_STREAM_RETRY: Duration = Duration::from_secs(2);
/// Bytes of a request's header.
pub const HTTP_HEADER_BYTES_MAX: usize = 32 * 1024;
/// Entries of a page of a list.
pub const HTTP_PAGE_MAX: u32 = 1_000;
/// Most deployments, and most returns to earlier values, read for a page of proposals.
pub const FOLLOWED_MAX: u32 = 10_000;
/// Default number of entries of a page of a list.
pub const HTTP_PAGE_DEFAULT: u32 = 100;
/// Proposals that one request approves.
pub const APPROVED_AT_ONCE_MAX: usize = 500;
/// Time within which decisions of one request must begin, or are skipped: the request is answered
/// before [`HTTP_WRITE_TIMEOUT`].
pub const APPROVED_WITHIN: Duration = Duration::from_secs(4);
/// Rows of the audit in one file.
pub const AUDIT_FILE_ROWS_MAX: u32 = 100_000;
/// Longest row of a downloaded audit that is read, bytes.
pub const AUDIT_ROW_BYTES_MAX: u64 = 1 << 20;
/// Certificates in one file.
pub const CERTIFICATE_FILE_ROWS_MAX: u32 = 100_000;
/// Rows of a list or a file that are read at once; the next ones follow once the client has
/// received these.
pub const LIST_ROWS_AT_ONCE: u32 = 128;
/// Files that are written at once.
pub const EXPORTS_MAX: usize = 8;
/// Files that are written at once for one user or token.
pub const EXPORTS_PER_CALLER_MAX: usize = 2;
/// Time within which a file must be received whole: 100,000 rows of the audit at 1 Mbit/s,
/// uncompressed.
pub const EXPORT_TAKEN_WITHIN: Duration = Duration::from_mins(15);
/// Writes of one user or token at once: a fleet is registered in one stroke. A request that decides
/// several proposals counts once for each.
pub const CALLER_WRITES_BURST: u32 = 1_000;
/// Time after which one more write is admitted: each may leave rows in the audit, which is kept.
pub const CALLER_WRITES_EVERY: Duration = Duration::from_secs(1);
/// Users and tokens whose writes are remembered.
pub const CALLER_WRITES_KEYS_MAX: usize = 4_096;
/// Interval at which refused writes of one user or token are logged.
pub const CALLER_WRITES_LOGGED_EVERY: Duration = Duration::from_mins(1);
/// Points of a chart's line that one request gets.
pub const HTTP_POINTS_MAX: u32 = 5_000;
/// Default number of points of a chart's line.
pub const HTTP_POINTS_DEFAULT: u32 = 600;
/// Default span of a robot's history, s.
pub const HTTP_HISTORY_SPAN_DEFAULT_S: i64 = 3_600;
/// Characters of an `Idempotency-Key`.
pub const HTTP_IDEMPOTENCY_KEY_CHARS_MAX: usize = 128;
/// Robots in one piece of `/metrics`; the next ones follow once the client has received these.
pub const METRICS_ROBOTS_AT_ONCE: usize = 128;
/// Time within which a request that changes something is answered, whatever the database does.
pub const HTTP_WRITE_TIMEOUT: Duration = Duration::from_millis(4_500);
/// Wait of `/readyz` for the database.
pub const READY_PROBE_TIMEOUT: Duration = Duration::from_secs(4);
/// Least interval between two writes of `/readyz` to the database.
pub const READY_PROBE_EVERY: Duration = Duration::from_secs(1);

/// Threads on which Zenoh receives. Declarations of all sessions wait for one lock there, so as
/// many sessions as there are threads can keep all others' data waiting; a waiting thread costs
/// nothing.
pub const ZENOH_RECEIVING_THREADS: usize = 64;
/// Queries for one of a robot's keys a second that a router with a generated list admits; an agent
/// sends one for each every few seconds.
pub const QUERIES_PER_S_MAX: f64 = 10.0;
/// Events and acknowledgements of one robot a second that such a router admits: notes have hourly
/// budgets, and a robot acknowledges once for each calibration.
pub const EVENTS_PER_S_MAX: f64 = 100.0;
/// Robots up to which a generated list limits the rates of their queries and messages: Zenoh keeps
/// the limits of all for each connection, which takes memory with the square of their number.
pub const ROBOTS_LIMITED_MAX: usize = 256;
/// Size of a file in which the start looks for endpoints, bytes: a generated list takes some 5 kB
/// for each robot.
pub const ZENOH_CONFIG_BYTES_MAX: u64 = 64 * 1024 * 1024;
/// Time limit of the whole shutdown.
pub const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(4);

/// Characters of the name of a user or a token.
pub const ACCOUNT_NAME_CHARS_MAX: usize = 64;
/// Fewest characters of a password.
pub const PASSWORD_CHARS_MIN: usize = 12;
/// Most characters of a password.
pub const PASSWORD_CHARS_MAX: usize = 128;
/// Passwords that are hashed at once, each with 19 MiB and a core.
pub const PASSWORD_HASHES_MAX: usize = 2;
/// Passwords from addresses unknown under their name that are hashed at once: the rest is left to
/// known ones.
pub const PASSWORD_HASHES_OF_STRANGERS_MAX: usize = 1;
/// Passwords that are hashed or wait for it, from addresses unknown under their name; further ones
/// are refused until later.
pub const PASSWORD_HASHES_WAITING_MAX: usize = 16;
/// Passwords that are hashed or wait for it, from addresses that have signed in under their name.
pub const PASSWORD_HASHES_KNOWN_WAITING_MAX: usize = 16;
/// Size beyond which allocations are mapped, and unmapped when they are freed: glibc's
/// `DEFAULT_MMAP_THRESHOLD_MAX` on 64 bits, up to which the threshold follows the freed sizes.
pub const ALLOCATOR_MAPS_BEYOND_BYTES: usize = 32 * 1024 * 1024;
/// Time after which an unused session ends.
pub const SESSION_IDLE_MAX: Duration = Duration::from_hours(12);
/// Time after which a session ends even if used.
pub const SESSION_MAX: Duration = Duration::from_hours(7 * 24);
/// Least interval between two records of the use of a session or token.
pub const SESSION_USE_NOTED_EVERY: Duration = Duration::from_mins(1);
/// Sessions of one user; a further one ends the oldest.
pub const SESSIONS_PER_USER_MAX: u32 = 16;
/// Interval at which an open event stream checks its listener's access.
pub const STREAM_ACCESS_CHECKED_EVERY: Duration = Duration::from_secs(2);
/// Validity of the code for the first administrator.
pub const SETUP_CODE_MAX: Duration = Duration::from_hours(24);
/// Codes for the first administrator: one for each of the latest starts without users.
pub const SETUP_CODES_MAX: u32 = 16;
/// Users in total.
pub const USERS_MAX: u32 = 10_000;
/// Tokens that are kept, revoked ones too.
pub const TOKENS_MAX: u32 = 10_000;
/// Longest validity of a token.
pub const TOKEN_EXPIRES_MAX: Duration = Duration::from_hours(10 * 365 * 24);
/// Time for which an answer of `security.txt` counts: RFC 9116 recommends less than a year.
pub const SECURITY_TXT_VALID_FOR: Duration = Duration::from_hours(180 * 24);
/// Shortest time for which a former signing key is accepted beside the new one.
pub const FORMER_KEY_ACCEPTED_MIN: Duration = Duration::from_mins(1);
/// Longest time for which a former signing key is accepted beside the new one.
pub const FORMER_KEY_ACCEPTED_MAX: Duration = Duration::from_hours(366 * 24);
/// Attempts to sign in under one name from one address at once.
pub const SIGN_IN_NAME_BURST: u32 = 10;
/// Time after which one more such attempt is admitted.
pub const SIGN_IN_NAME_EVERY: Duration = Duration::from_secs(30);
/// Attempts to sign in under one name from all addresses at once: far more than one address gets,
/// so that nobody locks somebody else out.
pub const SIGN_IN_EVERYWHERE_BURST: u32 = 100;
/// Time after which one more such attempt is admitted.
pub const SIGN_IN_EVERYWHERE_EVERY: Duration = Duration::from_secs(10);
/// Attempts to sign in from one address at once.
pub const SIGN_IN_ADDRESS_BURST: u32 = 60;
/// Time after which one more such attempt is admitted.
pub const SIGN_IN_ADDRESS_EVERY: Duration = Duration::from_secs(2);
/// Names, and addresses, whose attempts are remembered.
pub const SIGN_IN_KEYS_MAX: usize = 4_096;
/// Latest pairs of a name and an address it has signed in from that are remembered.
pub const SIGN_IN_KNOWN_MAX: usize = 4_096;

/// Time for which a cluster's instance keeps its robots after a renewal, by the database's clock.
pub const CLUSTER_LEASE: Duration = Duration::from_secs(6);
/// Margin before the end of its lease at which an instance stops acting.
pub const CLUSTER_LEASE_MARGIN: Duration = Duration::from_secs(1);
/// Time between two renewals.
pub const CLUSTER_RENEW_EVERY: Duration = Duration::from_secs(2);
/// Interval at which an instance reads the rows of the cluster.
pub const CLUSTER_LOOK_EVERY: Duration = Duration::from_millis(250);
/// Silence over Zenoh after which an instance counts as unheard by another one: the routers between
/// them are cut. Not before Zenoh itself would give a connection up: instances that do not hear each
/// other subscribe to each other's robots, and thousands of declarations delay heartbeats by more
/// than a second, so that a shorter limit keeps itself exceeded.
pub const CLUSTER_UNHEARD_AFTER: Duration = CLUSTER_ZENOH_LEASE;
/// Silence after which, while instances do not hear each other, a robot counts as unheard by the
/// instance that listens to it.
pub const CLUSTER_ROBOT_UNHEARD_AFTER: Duration = Duration::from_secs(2);
/// Time for which instances do not hear each other after which they subscribe to parked robots as
/// well: these may have begun to send at the other side.
pub const CLUSTER_ALL_HEARD_AFTER: Duration = Duration::from_secs(15);
/// Time after which an instance claims robots and duties that another one should have claimed.
pub const CLUSTER_CLAIM_OTHERS_AFTER: Duration = Duration::from_secs(2);
/// Robots that an instance hands over at once.
pub const CLUSTER_MOVES_AT_ONCE_MAX: usize = 256;
/// Time for which both instances receive a robot that is handed over: longer than messages wait for
/// each other in the estimator.
pub const CLUSTER_OVERLAP: Duration = Duration::from_secs(1);
/// Interval at which an instance declares the keys of robots that have begun to send.
pub const KEYS_DECLARED_EVERY: Duration = Duration::from_secs(1);
/// Age of its latest message up to which a robot counts as sending.
pub const SENDING_WITHIN: Duration = Duration::from_secs(5);
/// Time of its own successful renewals after which an instance may declare others dead: after an
/// outage of the database all leases are over at once.
pub const CLUSTER_CONNECTED_FOR: Duration = CLUSTER_LEASE;
/// Time without the database after which an instance stops answering robots' queries.
pub const CLUSTER_UNANSWERED_AFTER: Duration = Duration::from_secs(3);
/// Offset from the database's clock beyond which an instance is reported.
pub const CLUSTER_CLOCK_WARNED_BEYOND: Duration = Duration::from_secs(1);
/// Offset from the database's clock beyond which an instance gives up its robots.
pub const CLUSTER_CLOCK_USED_UP_TO: Duration = Duration::from_secs(10);
/// Wait of an ending instance for others to take its robots over.
pub const CLUSTER_DRAIN_TIMEOUT: Duration = Duration::from_secs(20);
/// Time within which the heir of a robot has subscribed to it.
pub const CLUSTER_SUBSCRIBED_WITHIN: Duration = Duration::from_secs(2);
/// Interval at which an instance reads the decisions of others.
pub const CLUSTER_FOLLOW_EVERY: Duration = Duration::from_millis(500);
/// Decisions of others that an instance reads at once.
pub const CLUSTER_FOLLOWED_MAX: u32 = 1_000;
/// Time without an instance after which a robot is reported.
pub const CLUSTER_NO_INSTANCE_AFTER: Duration = Duration::from_secs(15);
/// Robots that the text of this report names; the alert has all of them.
pub const CLUSTER_ROBOTS_NAMED_MAX: usize = 8;
/// Time within which another instance is connected, or the request is answered without it.
pub const PEER_CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// Time within which another instance begins to answer: less than [`HTTP_REQUEST_TIMEOUT`].
pub const PEER_ANSWER_TIMEOUT: Duration = Duration::from_secs(8);
/// Connections to another instance that are kept for further requests.
pub const PEER_IDLE_CONNECTIONS_MAX: usize = 8;
/// Interval at which the addresses of other instances are looked up.
pub const PEER_ADDRESSES_EVERY: Duration = Duration::from_secs(30);
/// Peers in an instance's configuration.
pub const PEERS_MAX: usize = 64;
/// Robots without an instance that one answer names.
pub const CLUSTER_ROBOTS_TOLD_MAX: usize = 100;
/// Time limit of a statement about the rows of the cluster, beyond which its connection is dropped:
/// a lease is renewed twice before it ends.
pub const CLUSTER_STATEMENT_TIMEOUT: Duration = Duration::from_millis(1_500);
/// Time for which an instance that was declared dead is shown.
pub const CLUSTER_DEAD_SHOWN_FOR: Duration = Duration::from_hours(24);
/// Adopted robots whose history is examined in one transaction.
pub const CLUSTER_ADOPTED_AT_ONCE_MAX: usize = 256;
/// Wheel odometry of a robot that waits for its adoption, while the robot is another instance's.
pub const HEARD_WHEEL_ODOMETRY_MAX: usize = 8_192;
/// Scans (or LiDAR poses) of such a robot.
pub const HEARD_SCANS_MAX: usize = 512;
/// Notes and other rare messages of such a robot.
pub const HEARD_NOTES_MAX: usize = MAILBOX_NOTES_MAX;
/// Bytes of its messages: a second of the largest clouds.
pub const HEARD_BYTES_MAX: usize = 16 * 1024 * 1024;
/// Interval at which an instance reports on its robots to the others.
pub const DIGEST_EVERY: Duration = Duration::from_secs(1);
/// Largest message of such a report, bytes.
pub const DIGEST_BYTES_MAX: usize = 256 * 1024;
/// Interval of complete reports on a robot; the ones between have the changes.
pub const REPORT_WHOLE_EVERY: Duration = Duration::from_secs(5);
/// Events of a robot in one report; further ones appear in its history alone.
pub const REPORT_EVENTS_MAX: usize = 32;
/// Messages of other instances that wait to be read.
pub const DIGESTS_WAITING_MAX: usize = 64;
/// Age of its report from which a robot of another instance is shown as stale.
pub const REPORTS_STALE_AFTER: Duration = Duration::from_secs(3);
/// Time for which unregistered robots are listened to.
pub const DISCOVERY_FOR: Duration = Duration::from_secs(2);
/// Interval at which that is repeated.
pub const DISCOVERY_EVERY: Duration = Duration::from_mins(1);
/// Silence after which a peer of a cluster's Zenoh session counts as gone.
pub const CLUSTER_ZENOH_LEASE: Duration = Duration::from_secs(3);
