//! Every limit of the service: queues, caches, bodies, waits. One name each, all in one place.

use std::time::Duration;

use fleetcal_model::Stream;

/// Largest message that the Zenoh transport puts together, in bytes: the largest payload, its key and
/// its attachment. A session can leave one unfinished on its reliable and one on its other channel.
pub const ZENOH_MESSAGE_BYTES_MAX: usize = payload_bytes_max(Stream::Scan) + 64 * 1024;

/// Largest payload taken from a robot on one stream, in bytes. A full mailbox of the largest ones
/// stays under 24 MiB; the largest scan is a cloud of 32,768 points of 48 bytes and some more.
pub const fn payload_bytes_max(stream: Stream) -> usize {
    match stream {
        // Joints and odometry are longer than a drive sample.
        Stream::WheelOdometry | Stream::Steering | Stream::Speed => 4 * 1024,
        Stream::Scan => 2 * 1024 * 1024,
        Stream::LidarOdometry => 64 * 1024,
        Stream::Event => 16 * 1024,
    }
}

/// Drive samples that wait in a robot's mailbox.
pub const MAILBOX_WHEEL_ODOMETRY_MAX: usize = 1_024;
/// Scans (or LiDAR poses) that wait in a robot's mailbox.
pub const MAILBOX_SCANS_MAX: usize = 8;
/// Notes and other rare messages that wait in a robot's mailbox.
pub const MAILBOX_NOTES_MAX: usize = 64;
/// Stored notes about a robot that are read at once to be brought to its estimator.
pub const NOTES_BROUGHT_MAX: u32 = 64;
/// A robot that sends has what has come worked off in rounds: waking its task for each message would
/// cost more than the message. All robots have their rounds at the same moments.
pub const TASK_ROUND: Duration = Duration::from_millis(20);
/// Rounds without a message after which a robot's task waits for the next one.
pub const TASK_IDLE_ROUNDS: u32 = 5;
/// Drive samples and scans that wait until the next round; further ones are worked off at once.
pub const TASK_ROUND_WHEEL_ODOMETRY_MAX: usize = 64;
/// See [`TASK_ROUND_WHEEL_ODOMETRY_MAX`].
pub const TASK_ROUND_SCANS_MAX: usize = 1;
/// Robots that are configured.
pub const ROBOTS_MAX: usize = 4_096;
/// Robots that send without being configured; further ones are counted and forgotten.
pub const UNREGISTERED_ROBOTS_MAX: usize = 256;
/// Live updates that a slow listener may lag behind before it loses the oldest.
pub const LIVE_UPDATES_MAX: usize = 4_096;
/// Characters of a note that a person or tool attaches.
pub const NOTE_CHARS_MAX: usize = 1_000;
/// Characters of a refusal's reason that are kept for the robot's page.
pub const REFUSAL_CHARS_MAX: usize = 300;

/// ROS 2 topics that a robot can have announced; further ones are left out.
pub const ANNOUNCED_TOPICS_MAX: usize = 256;
/// ROS 2 tokens that are remembered at once; further ones are left out.
pub const ROS2_TOKENS_MAX: usize = 16_384;

/// The same of one robot, which has some for each topic that it sends or takes.
pub const ROS2_TOKENS_OF_ROBOT_MAX: usize = 1_024;
/// Longest ROS 2 token that is read.
pub const ROS2_TOKEN_BYTES_MAX: usize = 1_024;
/// Places, of a prefix and a key layout, that one robot's ROS 2 topics can have at once.
pub const ROS2_HOMES_MAX: usize = 4;

/// A robot is warned of for so long after its last message on a former key of a stream.
pub const FORMER_KEY_WARNED_FOR: Duration = Duration::from_secs(30);

/// Answers of one robot that wait to be stored; a further one pushes the oldest out.
pub const ANSWERS_OF_ROBOT_MAX: usize = 4;
/// Answers of one robot that say something new and are stored, an hour. What answers the deployment
/// under way is stored besides.
pub const ANSWERS_PER_HOUR_MAX: u32 = 20;
/// Answers of one robot that are looked at, an hour: an agent repeats one every five seconds.
pub const ANSWERS_HEARD_PER_HOUR_MAX: u32 = 3_600;
/// Notes that one robot puts into its history, an hour; what people note is not counted.
pub const NOTES_PER_HOUR_MAX: u32 = 20;
/// Bytes of text in these.
pub const NOTE_BYTES_PER_HOUR_MAX: u32 = 8 * 1024;
/// Events that a robot's estimator puts into its history, an hour.
pub const EVENTS_PER_HOUR_MAX: u32 = 60;
/// Losses of one kind and robot are logged this often.
pub const LOSSES_LOGGED_EVERY: Duration = Duration::from_mins(1);
/// Losses of all robots that are logged in that time.
pub const LOSSES_LOGGED_MAX: usize = 60;
/// Longest cross-track error of a robot, in bytes.
pub const CROSS_TRACK_BYTES_MAX: usize = 1_024;
/// Longest answer of a robot, in bytes.
pub const ANSWER_BYTES_MAX: usize = 16 * 1024;
/// Robots' questions that the database answers at once or that wait for it: one of each robot.
/// Further ones get no answer. An agent asks again; a ROS 2 node hears the next approval.
pub const QUESTIONS_MAX: usize = ROBOTS_MAX;
/// What could not be sent is tried again after this long.
pub const POST_RETRY: Duration = Duration::from_secs(5);
/// What waits to be sent is looked through at least this often.
pub const POST_EVERY: Duration = Duration::from_secs(30);

/// Sightings of alerts that one transaction takes; the rest follows a second later.
pub const ALERTS_AT_ONCE_MAX: usize = 1_000;
/// Changes of one alert that are remembered, the latest.
pub const ALERT_CHANGES_MAX: u32 = 500;
/// Alerts that are over are kept this long.
pub const ALERTS_KEPT: Duration = Duration::from_hours(365 * 24);

/// Webhooks at once.
pub const WEBHOOKS_MAX: usize = 16;
/// Longest address of a webhook, in bytes.
pub const WEBHOOK_URL_BYTES_MAX: usize = 2_000;
/// Messages that wait for one receiver; beyond, the oldest is given up.
pub const WEBHOOK_WAITING_MAX: u32 = 1_000;
/// Messages of one webhook that are kept after they were taken or given up, the latest.
pub const WEBHOOK_LOG_MAX: u32 = 1_000;
/// Attempts of one message that are kept, the latest.
pub const WEBHOOK_ATTEMPTS_KEPT: usize = 20;
/// A message is looked for this often.
pub const WEBHOOK_LOOK_EVERY: Duration = Duration::from_secs(1);
/// A receiver must take the connection within this time.
pub const WEBHOOK_CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// A receiver must have answered within this time.
pub const WEBHOOK_TIMEOUT: Duration = Duration::from_secs(10);
/// Bytes of the header of a receiver's answer; its body is not read.
pub const WEBHOOK_ANSWER_BYTES_MAX: usize = 16 * 1024;
/// Characters of an attempt's error that are kept.
pub const WEBHOOK_ERROR_CHARS_MAX: usize = 300;
/// The first wait after a failed attempt; it doubles with each.
pub const WEBHOOK_BACKOFF_FIRST: Duration = Duration::from_secs(5);
/// The longest wait between two attempts.
pub const WEBHOOK_BACKOFF_MAX: Duration = Duration::from_hours(1);
/// A message that was not taken for so long is given up.
pub const WEBHOOK_RETRY_FOR: Duration = Duration::from_hours(24);

/// A robot is stale after this long without data.
pub const STALE_AFTER: Duration = Duration::from_secs(3);
/// A session of a robot ends after this long without data.
pub const SESSION_ENDS_AFTER: Duration = Duration::from_secs(10);
/// A robot's session ends this long after its liveliness token went, with nothing more to come.
pub const SESSION_ENDS_AFTER_TOKEN: Duration = Duration::from_millis(500);
/// Message time between two checkpoints of a robot that learns, verifies or has a candidate, and at most
/// that of every robot of a cluster, s.
pub const CHECKPOINT_EVERY_S: f64 = 10.0;
/// Message time between two checkpoints of a cluster's robot that has just begun, s.
pub const CHECKPOINT_OF_CLUSTER_MIN_S: f64 = 5.0;
/// Message time between two checkpoints of a cluster's robot as a share of its session: a takeover loses no
/// more than that of what was learnt, and the seconds that it takes itself.
pub const CHECKPOINT_OF_CLUSTER_SHARE: f64 = 0.05;
/// Message time between two checkpoints of a calibrated robot of a service that is alone, s.
pub const CHECKPOINT_CALIBRATED_EVERY_S: f64 = 60.0;
/// Bytes of a checkpoint once it is decompressed; those of a robot that verifies are some 50 KiB.
pub const CHECKPOINT_BYTES_MAX: usize = 1024 * 1024;
/// Messages of a robot overtake each other by less than this, s of message time: a verification run
/// begins so long after the first message that came after the robot's acknowledgement.
pub const IN_FLIGHT_S: f64 = 1.0;

/// How often a robot's next manoeuvres are ranked, s of message time.
pub const ADVICE_EVERY_S: f64 = 5.0;
/// Askers for a robot's top view that wait; later ones are told to ask again.
pub const TOP_VIEW_ASKERS_MAX: usize = 64;
/// Those who ask again within this much message time get the same view, s.
pub const TOP_VIEW_EVERY_S: f64 = 0.4;
/// A top view shows surfaces this far from the LiDAR, m.
pub const TOP_VIEW_REACH_M: f64 = 30.0;
/// Points of surfaces in a top view, the nearest.
pub const TOP_VIEW_SURFACES_MAX: usize = 4_096;
/// Length of a top view's trajectories, m by the wheels.
pub const TOP_VIEW_TRAJECTORY_M: f64 = 20.0;
/// Points of each trajectory.
pub const TOP_VIEW_TRAJECTORY_POINTS_MAX: usize = 200;
/// Recordings of robots that are made at once.
pub const RECORDINGS_MAX: usize = 8;
/// What waits for the writer of a recording, in number.
pub const RECORDING_WAITING_MAX: usize = 4_096;
/// What waits for the writer of a recording, bytes of the robot's messages.
pub const RECORDING_WAITING_BYTES_MAX: usize = 16 * 1024 * 1024;
/// Longest recording of a robot, s.
pub const RECORDING_DURATION_MAX_S: u32 = 3_600;
/// A robot is recorded for so long unless asked for otherwise, s.
pub const RECORDING_DURATION_DEFAULT_S: u32 = 60;
/// A recording ends when it is longer, bytes.
pub const RECORDING_BYTES_MAX: u64 = 1024 * 1024 * 1024;
/// Pieces of a recording that wait for the client that fetches it.
pub const RECORDING_PIECES_WAITING_MAX: usize = 4;
/// A download that stalls for this long is aborted.
pub const RECORDING_STALLED_AFTER: Duration = Duration::from_secs(30);
/// All that is left of a recording at its end has to be taken within this.
pub const RECORDING_REST_TAKEN_WITHIN: Duration = Duration::from_secs(30);
/// Times an estimator is restarted after a panic before its robot is left alone.
pub const ESTIMATOR_RESTARTS_MAX: u32 = 10;

/// Rows of telemetry that wait for the store.
pub const STORE_QUEUE_MAX: usize = 16_384;
/// Telemetry is committed at least this often.
pub const STORE_FLUSH_EVERY: Duration = Duration::from_secs(1);
/// Seconds of history that are gathered before they are written early.
pub const STORE_BATCH_MAX: usize = 4_096;
/// Rows of telemetry in one transaction: a job waits for at most one such transaction, some 30 ms.
pub const STORE_TELEMETRY_ROWS_MAX: usize = 256;
/// Jobs that wait for the store.
pub const STORE_JOBS_MAX: usize = 1_024;
/// Jobs in one transaction.
pub const STORE_JOBS_AT_ONCE_MAX: usize = 128;
/// A robot's latest estimate is stored at most this often; its history every second.
pub const STORE_CURRENT_EVERY: Duration = Duration::from_secs(10);
/// The same for one that learns no parameter, as with its checkpoints.
pub const STORE_CURRENT_LEARNT_EVERY: Duration = Duration::from_mins(1);
/// Connections that read the database.
pub const STORE_READERS_MAX: u32 = 4;
/// A reader waits this long for a connection, a writer for a place in the queue.
pub const STORE_READ_TIMEOUT: Duration = Duration::from_secs(5);
/// A write waits this long for another process to let go of the database. Two such waits and the
/// pause between them fit into [`STORE_ANSWER_WITHIN`].
pub const STORE_BUSY_TIMEOUT: Duration = Duration::from_millis(1_500);
/// A write whose turn comes later than this is refused: whoever asked has been told so already.
pub const STORE_ANSWER_WITHIN: Duration = Duration::from_secs(4);
/// How often it is looked at whether the writer gets on.
pub const STORE_LOOK_EVERY: Duration = Duration::from_secs(5);
/// A writer that has not written for so long, though the database takes writes, is stuck.
pub const STORE_STUCK_AFTER: Duration = Duration::from_mins(1);
/// A PostgreSQL server is connected, and left by another service, within this time or not used.
pub const POSTGRES_CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// When one of several hosts does not answer, the next one is asked after this.
pub const POSTGRES_NEXT_HOST_AFTER: Duration = Duration::from_millis(250);
/// A statement on PostgreSQL has ended within this time, or its connection is given up.
pub const POSTGRES_STATEMENT_TIMEOUT: Duration = Duration::from_secs(3);
/// The same for a statement that reads, which may give all robots' states.
pub const POSTGRES_READ_TIMEOUT: Duration = Duration::from_secs(10);
/// The same for all migrations, which another process may be at, and for rows that are copied.
pub const POSTGRES_BULK_TIMEOUT: Duration = Duration::from_mins(10);
/// Seconds of history are in their minutes and hours in PostgreSQL after this time.
pub const POSTGRES_ROLL_UP_EVERY: Duration = Duration::from_mins(1);
/// Minutes that may wait for that; more are rolled up at once.
pub const POSTGRES_ROLL_UP_WAITING_MAX: usize = 20_000;
/// Minutes that are rolled up in one transaction.
pub const POSTGRES_ROLL_UP_MAX: usize = 512;
/// Days whose partitions are known to be there.
pub const POSTGRES_DAYS_KNOWN_MAX: usize = 16;
/// How often a job is run that PostgreSQL could not bring into an order with others.
pub const POSTGRES_CONFLICT_TRIES: u32 = 12;
/// The pause between these.
pub const POSTGRES_CONFLICT_PAUSE: Duration = Duration::from_millis(20);
/// After a commit that failed, the next one begins after this; each further failure doubles it.
pub const STORE_RETRY_FIRST: Duration = Duration::from_millis(100);
/// Longest pause between two commits while the database fails.
pub const STORE_RETRY_MAX: Duration = Duration::from_secs(1);
/// Commits that are tried when the store is closed, before what is left is lost.
pub const STORE_CLOSE_TRIES: u32 = 4;
/// Seconds of history are kept this long after their receipt.
pub const HISTORY_SECONDS_KEPT: Duration = Duration::from_hours(3 * 24);
/// Minutes of history are kept this long after their receipt.
pub const HISTORY_MINUTES_KEPT: Duration = Duration::from_hours(90 * 24);
/// Hours of history, and events, are kept this long after their receipt.
pub const HISTORY_HOURS_KEPT: Duration = Duration::from_hours(5 * 365 * 24);
/// Answers to requests with an `Idempotency-Key` are kept this long.
pub const IDEMPOTENCY_KEPT: Duration = Duration::from_hours(24);
/// Old rows of one kind that are deleted at a time, once a second.
pub const RETENTION_ROWS_MAX: u32 = 2_000;
/// A clock that is ahead of running time by so many seconds was set, and has not drifted.
pub const CLOCK_STEP_S: i64 = 3_600;
/// A clock that was set forward and stays there for so long is believed by retention.
pub const CLOCK_STEP_BELIEVED_AFTER: Duration = Duration::from_hours(24);
/// Rows of one tier of the history that one request reads.
pub const HISTORY_ROWS_MAX: i64 = 4 * 3_600;

/// Longest body of an HTTP request, in bytes.
pub const HTTP_BODY_BYTES_MAX: usize = 64 * 1024;
/// HTTP connections served at once. For a further one of an address of which none waits for its peer,
/// one of the address of which most wait is cut.
pub const HTTP_CONNECTIONS_MAX: usize = 512;
/// A connection that has waited for its peer for so long is cut for another one of its address, when
/// that has as many as it may have.
pub const HTTP_EVICTED_AFTER: Duration = Duration::from_secs(1);
/// Bytes of answers that the system holds for a peer that reads slowly; Linux takes twice as much, for
/// its own bookkeeping.
pub const HTTP_SEND_BUFFER_BYTES: u32 = 256 * 1024;
/// HTTP connections that wait to be accepted; the system may have a lower limit.
pub const HTTP_BACKLOG: u32 = 4_096;
/// HTTP connections of one address (IPv6: of one /64 network), trusted proxies excepted.
pub const HTTP_CONNECTIONS_PER_ADDRESS_MAX: usize = 64;
/// HTTP requests under way at once; the connections beyond that are left to probes.
pub const HTTP_REQUESTS_MAX: usize = HTTP_CONNECTIONS_MAX - 32;
/// HTTP requests under way from one address, also of a client behind a trusted proxy.
pub const HTTP_REQUESTS_PER_ADDRESS_MAX: usize = 64;
/// A client must have sent its request's header within this time.
pub const HTTP_HEADER_TIMEOUT: Duration = Duration::from_secs(10);
/// A request's body must have come within this time; a little longer than
/// [`HTTP_REQUEST_TIMEOUT`], by which its route has answered.
pub const HTTP_BODY_TIMEOUT: Duration = Duration::from_secs(12);
/// A client must take something of an answer within this time; the recording of a robot has
/// [`RECORDING_STALLED_AFTER`].
pub const HTTP_WRITE_STALL_TIMEOUT: Duration = Duration::from_secs(10);
/// What the service may wait for a client in all, until that has sent a request and begun to take what
/// answers it: for header, body and a first stall together, each of which has its own limit besides.
pub const HTTP_PEER_TIMEOUT: Duration = Duration::from_secs(14);
/// A request is answered within this time (event streams excepted).
pub const HTTP_REQUEST_TIMEOUT: Duration = Duration::from_secs(10);
/// Listeners of the event stream at once.
pub const HTTP_STREAMS_MAX: usize = 64;
/// Listeners of the event stream that are one user or token.
pub const HTTP_STREAMS_PER_CALLER_MAX: usize = 8;
/// Listeners of the event stream at one address.
pub const HTTP_STREAMS_PER_ADDRESS_MAX: usize = 32;
/// The fleet's lean rows are told this often.
pub const HTTP_STREAM_ROWS_EVERY: Duration = Duration::from_secs(1);
/// Topics of one event stream: a page shows one robot, or a few beside each other.
pub const HTTP_STREAM_TOPICS_MAX: usize = 8;
/// An event stream without news says this often that it is there.
pub const HTTP_STREAM_KEEP_ALIVE: Duration = Duration::from_secs(10);
/// A listener whose event stream broke off comes back after this long.
pub const HTTP_STREAM_RETRY: Duration = Duration::from_secs(2);
/// Bytes of a request's header.
pub const HTTP_HEADER_BYTES_MAX: usize = 32 * 1024;
/// Entries of a page of a list.
pub const HTTP_PAGE_MAX: u32 = 1_000;
/// Most deployments, and most returns to earlier values, read for a page of proposals.
pub const FOLLOWED_MAX: u32 = 10_000;
/// Entries of a page of a list unless asked for otherwise.
pub const HTTP_PAGE_DEFAULT: u32 = 100;
/// Proposals that one request approves.
pub const APPROVED_AT_ONCE_MAX: usize = 500;
/// Approvals of one request that have not begun within this are not tried: the request is answered
/// before [`HTTP_WRITE_TIMEOUT`].
pub const APPROVED_WITHIN: Duration = Duration::from_secs(4);
/// Rows of the audit in one file.
pub const AUDIT_FILE_ROWS_MAX: u32 = 100_000;
/// Rows of a list or a file that are read at once; the next ones once the client has taken these.
pub const LIST_ROWS_AT_ONCE: u32 = 128;
/// Files that are written at once.
pub const EXPORTS_MAX: usize = 8;
/// Files that are written at once for one user or token.
pub const EXPORTS_PER_CALLER_MAX: usize = 2;
/// A file has been taken whole within this time: 100,000 rows of the audit at 1 Mbit/s, uncompressed.
pub const EXPORT_TAKEN_WITHIN: Duration = Duration::from_mins(15);
/// Writes of one user or token at once: a fleet is registered in one stroke. One request that decides
/// several proposals counts as so many.
pub const CALLER_WRITES_BURST: u32 = 1_000;
/// The time after which one more is let through: each may leave rows in the audit, which is kept.
pub const CALLER_WRITES_EVERY: Duration = Duration::from_secs(1);
/// Users and tokens whose writes are remembered.
pub const CALLER_WRITES_KEYS_MAX: usize = 4_096;
/// Refused writes of one user or token are logged this often.
pub const CALLER_WRITES_LOGGED_EVERY: Duration = Duration::from_mins(1);
/// Points of a chart's line that one request gets.
pub const HTTP_POINTS_MAX: u32 = 5_000;
/// Points of a chart's line unless asked for otherwise.
pub const HTTP_POINTS_DEFAULT: u32 = 600;
/// Span of a robot's history unless asked for otherwise, s.
pub const HTTP_HISTORY_SPAN_DEFAULT_S: i64 = 3_600;
/// Characters of an `Idempotency-Key`.
pub const HTTP_IDEMPOTENCY_KEY_CHARS_MAX: usize = 128;
/// Robots of which `/metrics` writes at once; the next ones once the client has taken these.
pub const METRICS_ROBOTS_AT_ONCE: usize = 128;
/// A request that changes something is answered within this, whatever the database does.
pub const HTTP_WRITE_TIMEOUT: Duration = Duration::from_millis(4_500);
/// `/readyz` waits this long for the database.
pub const READY_PROBE_TIMEOUT: Duration = Duration::from_secs(4);
/// `/readyz` writes to the database at most this often.
pub const READY_PROBE_EVERY: Duration = Duration::from_secs(1);

/// Threads on which Zenoh receives. Declarations of all sessions wait for one lock there, so as many
/// sessions as there are threads can keep all others' data waiting; a thread that waits costs nothing.
pub const ZENOH_RECEIVING_THREADS: usize = 64;
/// Queries for one of a robot's keys a second that a router with a generated list lets through; an agent
/// asks for each once in seconds.
pub const QUERIES_PER_S_MAX: f64 = 10.0;
/// Events and acknowledgements of one robot a second that such a router lets through: notes have budgets of
/// an hour, and a robot acknowledges once for each calibration.
pub const EVENTS_PER_S_MAX: f64 = 100.0;
/// A generated list limits how often robots ask and tell up to so many robots: Zenoh keeps the limits of all
/// for each connection, which takes memory with the square of their number.
pub const ROBOTS_LIMITED_MAX: usize = 256;
/// A file in which the start looks for endpoints: a generated list takes some 5 kB for each robot.
pub const ZENOH_CONFIG_BYTES_MAX: u64 = 64 * 1024 * 1024;
/// Connections to the Zenoh port that have not said who they are, at once; one more waits.
pub const ZENOH_HANDSHAKES_MAX: usize = ROBOTS_MAX;
/// A connection to the Zenoh port has said who it is within this time.
pub const ZENOH_HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(3);
/// Zenoh sessions of all peers together. When all places are taken, who has the most gives one to a
/// peer that has fewer.
pub const ZENOH_SESSIONS_MAX: usize = ROBOTS_MAX;
/// Zenoh sessions of one address whose peers show no name: of a fleet behind one gateway.
pub const ZENOH_SESSIONS_PER_ADDRESS_MAX: usize = ZENOH_SESSIONS_MAX / 4;
/// Zenoh sessions of one name, by password or certificate: of a fleet whose robots share one.
pub const ZENOH_SESSIONS_PER_NAME_MAX: usize = ZENOH_SESSIONS_MAX / 4;
/// Sessions that Zenoh opens beyond, so that one can come whose place is another's still.
pub const ZENOH_SESSIONS_OPENING_MAX: usize = 256;
/// Log lines about places of Zenoh sessions, an hour.
pub const ZENOH_SESSION_LINES_PER_HOUR_MAX: u32 = 60;
/// Lines that Zenoh itself logs, an hour: peers can make it log at will.
pub const ZENOH_LOG_LINES_PER_HOUR_MAX: u32 = 1_200;
/// Opening the Zenoh session may take this long.
pub const ZENOH_OPEN_TIMEOUT: Duration = Duration::from_secs(10);
/// Closing it may take this long; after that the process ends without.
pub const ZENOH_CLOSE_TIMEOUT: Duration = Duration::from_secs(1);
/// The whole shutdown may take this long.
pub const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(4);

/// Characters of the name of a user or a token.
pub const ACCOUNT_NAME_CHARS_MAX: usize = 64;
/// Fewest characters of a password.
pub const PASSWORD_CHARS_MIN: usize = 12;
/// Most characters of a password.
pub const PASSWORD_CHARS_MAX: usize = 128;
/// Passwords that are hashed at once, each with 19 MiB and a core.
pub const PASSWORD_HASHES_MAX: usize = 2;
/// Passwords from addresses that have not signed in under their name that are hashed at once: the
/// rest is left to those that have.
pub const PASSWORD_HASHES_OF_STRANGERS_MAX: usize = 1;
/// Passwords that are hashed or wait for it, from addresses that have not signed in under their
/// name; further ones are refused until later.
pub const PASSWORD_HASHES_WAITING_MAX: usize = 16;
/// The same from addresses that have signed in under their name.
pub const PASSWORD_HASHES_KNOWN_WAITING_MAX: usize = 16;
/// Allocations of more bytes than this are mapped, and unmapped when they are freed: glibc's
/// `DEFAULT_MMAP_THRESHOLD_MAX` on 64 bits, up to which the threshold follows what was freed.
pub const ALLOCATOR_MAPS_BEYOND_BYTES: usize = 32 * 1024 * 1024;
/// A session that is not used ends after this long.
pub const SESSION_IDLE_MAX: Duration = Duration::from_hours(12);
/// A session ends after this long however much it is used.
pub const SESSION_MAX: Duration = Duration::from_hours(7 * 24);
/// The use of a session or token is written down at most this often.
pub const SESSION_USE_NOTED_EVERY: Duration = Duration::from_mins(1);
/// Sessions of one user; the oldest ends when there would be more.
pub const SESSIONS_PER_USER_MAX: u32 = 16;
/// An open event stream asks this often whether its listener may still hear.
pub const STREAM_ACCESS_CHECKED_EVERY: Duration = Duration::from_secs(2);
/// The code for the first administrator counts this long.
pub const SETUP_CODE_MAX: Duration = Duration::from_hours(24);
/// Codes for the first administrator: one for each of the latest starts without users.
pub const SETUP_CODES_MAX: u32 = 16;
/// Users.
pub const USERS_MAX: u32 = 10_000;
/// Tokens that are kept, revoked ones too.
pub const TOKENS_MAX: u32 = 10_000;
/// Longest time that a token can be made to count.
pub const TOKEN_EXPIRES_MAX: Duration = Duration::from_hours(10 * 365 * 24);
/// Tries to sign in under one name from one address at once, and the time after which one more is
/// let through.
pub const SIGN_IN_NAME_BURST: u32 = 10;
/// See [`SIGN_IN_NAME_BURST`].
pub const SIGN_IN_NAME_EVERY: Duration = Duration::from_secs(30);
/// The same under one name from all addresses together: far more than one address gets, so that
/// nobody keeps somebody else out.
pub const SIGN_IN_EVERYWHERE_BURST: u32 = 100;
/// See [`SIGN_IN_EVERYWHERE_BURST`].
pub const SIGN_IN_EVERYWHERE_EVERY: Duration = Duration::from_secs(10);
/// Tries to sign in from one address at once, and the time after which one more is let through.
pub const SIGN_IN_ADDRESS_BURST: u32 = 60;
/// See [`SIGN_IN_ADDRESS_BURST`].
pub const SIGN_IN_ADDRESS_EVERY: Duration = Duration::from_secs(2);
/// Names, and addresses, whose tries are remembered.
pub const SIGN_IN_KEYS_MAX: usize = 4_096;
/// Names that have signed in from an address that are remembered, the latest.
pub const SIGN_IN_KNOWN_MAX: usize = 4_096;

/// A cluster's instance has its robots for so long after a renewal, by the database's clock.
pub const CLUSTER_LEASE: Duration = Duration::from_secs(6);
/// It stops acting so long before that.
pub const CLUSTER_LEASE_MARGIN: Duration = Duration::from_secs(1);
/// Time between two renewals.
pub const CLUSTER_RENEW_EVERY: Duration = Duration::from_secs(2);
/// How often an instance looks at the rows of the cluster.
pub const CLUSTER_LOOK_EVERY: Duration = Duration::from_millis(250);
/// An instance of which another one has heard nothing over Zenoh for so long is unheard by it: the
/// routers between them are cut.
pub const CLUSTER_UNHEARD_AFTER: Duration = Duration::from_secs(1);
/// While instances do not hear each other: a robot to which one has listened for so long without a
/// message is unheard by it.
pub const CLUSTER_ROBOT_UNHEARD_AFTER: Duration = Duration::from_secs(2);
/// What the instance that should have taken something has not taken by then, another one takes.
pub const CLUSTER_CLAIM_OTHERS_AFTER: Duration = Duration::from_secs(2);
/// Robots that an instance hands over at once.
pub const CLUSTER_MOVES_AT_ONCE_MAX: usize = 256;
/// For so long both instances hear a robot that is handed over: longer than messages wait for each
/// other in the estimator.
pub const CLUSTER_OVERLAP: Duration = Duration::from_secs(1);
/// How often an instance declares the keys of robots that have begun to send.
pub const KEYS_DECLARED_EVERY: Duration = Duration::from_secs(1);
/// A robot of which something came within this time is one that sends.
pub const SENDING_WITHIN: Duration = Duration::from_secs(5);
/// An instance takes others for dead only after its own renewals have worked for so long: after an
/// outage of the database all leases are over at once.
pub const CLUSTER_CONNECTED_FOR: Duration = CLUSTER_LEASE;
/// An instance that has not reached the database for so long answers robots' questions no more.
pub const CLUSTER_UNANSWERED_AFTER: Duration = Duration::from_secs(3);
/// An instance whose clock is further from the database's is reported.
pub const CLUSTER_CLOCK_WARNED_BEYOND: Duration = Duration::from_secs(1);
/// An instance whose clock is further from the database's gives up its robots.
pub const CLUSTER_CLOCK_USED_UP_TO: Duration = Duration::from_secs(10);
/// An instance that ends waits for so long for others to take its robots over.
pub const CLUSTER_DRAIN_TIMEOUT: Duration = Duration::from_secs(20);
/// An instance that is to have a robot next has subscribed to it within this time.
pub const CLUSTER_SUBSCRIBED_WITHIN: Duration = Duration::from_secs(2);
/// How often an instance looks for what others have decided.
pub const CLUSTER_FOLLOW_EVERY: Duration = Duration::from_millis(500);
/// Decisions of others that an instance takes at once.
pub const CLUSTER_FOLLOWED_MAX: u32 = 1_000;
/// A robot without an instance for so long is reported.
pub const CLUSTER_NO_INSTANCE_AFTER: Duration = Duration::from_secs(15);
/// Robots that the text of that names; the alert has all of them.
pub const CLUSTER_ROBOTS_NAMED_MAX: usize = 8;
/// Another instance is connected within this time, or the request is answered without it.
pub const PEER_CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// Another instance begins to answer within this time: less than [`HTTP_REQUEST_TIMEOUT`].
pub const PEER_ANSWER_TIMEOUT: Duration = Duration::from_secs(8);
/// Connections to another instance that are kept for further requests.
pub const PEER_IDLE_CONNECTIONS_MAX: usize = 8;
/// How often the addresses of other instances are looked up.
pub const PEER_ADDRESSES_EVERY: Duration = Duration::from_secs(30);
/// Instances that one is told of.
pub const PEERS_MAX: usize = 64;
/// Robots without an instance that one answer names.
pub const CLUSTER_ROBOTS_TOLD_MAX: usize = 100;
/// A statement about the rows of the cluster has ended within this time, or its connection is given
/// up: a lease is renewed twice before it ends.
pub const CLUSTER_STATEMENT_TIMEOUT: Duration = Duration::from_millis(1_500);
/// An instance that was taken for dead is shown for so long.
pub const CLUSTER_DEAD_SHOWN_FOR: Duration = Duration::from_hours(24);
/// Robots that an instance has begun to estimate whose history is looked at in one transaction.
pub const CLUSTER_ADOPTED_AT_ONCE_MAX: usize = 256;
/// Wheel odometry of a robot that an instance is about to have, while the robot is another's.
pub const HEARD_WHEEL_ODOMETRY_MAX: usize = 8_192;
/// Scans (or LiDAR poses) of such a robot.
pub const HEARD_SCANS_MAX: usize = 512;
/// Notes and other rare messages of such a robot.
pub const HEARD_NOTES_MAX: usize = MAILBOX_NOTES_MAX;
/// Bytes of its messages: a second of the largest clouds.
pub const HEARD_BYTES_MAX: usize = 16 * 1024 * 1024;
/// What an instance tells the others of its robots, it tells this often.
pub const DIGEST_EVERY: Duration = Duration::from_secs(1);
/// What it tells has at most so many bytes in one message.
pub const DIGEST_BYTES_MAX: usize = 256 * 1024;
/// All there is to tell of a robot is told this often, and what has changed in between.
pub const REPORT_WHOLE_EVERY: Duration = Duration::from_secs(5);
/// Events of a robot that are told at once; further ones are seen in its history alone.
pub const REPORT_EVENTS_MAX: usize = 32;
/// Messages of other instances that wait to be read.
pub const DIGESTS_WAITING_MAX: usize = 64;
/// A robot of which its instance tells nothing for so long is shown as stale.
pub const REPORTS_STALE_AFTER: Duration = Duration::from_secs(3);
/// Robots that nobody has registered are listened to for so long.
pub const DISCOVERY_FOR: Duration = Duration::from_secs(2);
/// And this often.
pub const DISCOVERY_EVERY: Duration = Duration::from_mins(1);
/// A peer of a cluster's Zenoh session is gone after so long without a sign of it.
pub const CLUSTER_ZENOH_LEASE: Duration = Duration::from_secs(3);
