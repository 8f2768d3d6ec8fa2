//! Records of the database: who had which robot, and who wrote what, each with the moment of its
//! commit. Triggers note both in the transaction itself; an instance is known by its role.

use std::net::IpAddr;
use std::path::Path;

use fleetcal_contract::own_server::{OwnServer, psql};
use fleetcal_store::database_url::PostgresUrl;
use fleetcal_tests::service::wait_for;

use crate::checker::{Audited, Evidence, Owned, Written};
use crate::processes;

/// Tables of telemetry that an instance writes for its own robots alone.
const TABLES: [&str; 4] = [
    "history_second",
    "history_minute",
    "robot_current",
    "checkpoint",
];

/// Starts a server that records the time of each commit, which also listens at a further address.
pub fn server(address: Option<IpAddr>) -> OwnServer {
    let mut server = OwnServer::start_new("trust");
    // Each instance has some ten connections, and those of a former life stay for a moment.
    let url = server.url("postgres");
    psql(&url, "ALTER SYSTEM SET track_commit_timestamp = on");
    if let Some(address) = address {
        server.listen_at(address);
    }
    server.stop();
    server.start();
    server
}

/// Kills the postmaster and all of its processes at once: data in its memory alone are lost.
pub fn kill_processes(url: &PostgresUrl) {
    let postmaster = psql(
        url,
        "SELECT split_part(pg_read_file('postmaster.pid'), E'\\n', 1)",
    );
    let postmaster: u32 = postmaster.trim().parse().unwrap();
    let parents = processes::parents().into_iter();
    let own = parents.filter(|(_, parent)| *parent == postmaster);
    let mut pids = vec![postmaster];
    pids.extend(own.map(|(pid, _)| pid));
    assert!(pids.len() > 5, "{pids:?}");
    processes::signal("KILL", &pids);
    let left = Path::new("/proc").join(postmaster.to_string());
    wait_for("the end of the server", || (!left.exists()).then_some(()));
}

/// Makes a role for each instance and records changes of owners and writes from now on. The schema
/// has to exist.
pub fn watch(url: &PostgresUrl, instances: &[&str]) {
    for name in instances {
        psql(url, &format!("CREATE ROLE {name} SUPERUSER LOGIN"));
    }
    psql(
        url,
        "CREATE TABLE seen_owner (n BIGINT GENERATED ALWAYS AS IDENTITY, robot BIGINT,
            instance TEXT, epoch BIGINT);
        CREATE FUNCTION see_owner() RETURNS trigger LANGUAGE plpgsql AS $$
        BEGIN
            INSERT INTO seen_owner (robot, instance, epoch)
                VALUES (NEW.robot, NEW.instance, NEW.epoch);
            RETURN NULL;
        END $$;
        CREATE TRIGGER owner_is_seen AFTER UPDATE ON robot_owner FOR EACH ROW
            WHEN ((OLD.instance, OLD.incarnation, OLD.epoch)
                IS DISTINCT FROM (NEW.instance, NEW.incarnation, NEW.epoch))
            EXECUTE FUNCTION see_owner();
        CREATE TABLE seen_duty (n BIGINT GENERATED ALWAYS AS IDENTITY, name TEXT, instance TEXT,
            at_ns BIGINT);
        CREATE FUNCTION see_duty() RETURNS trigger LANGUAGE plpgsql AS $$
        BEGIN
            INSERT INTO seen_duty (name, instance, at_ns)
                VALUES (NEW.name, NEW.instance, clock_ns());
            RETURN NULL;
        END $$;
        CREATE TRIGGER duty_is_seen AFTER UPDATE ON duty FOR EACH ROW EXECUTE FUNCTION see_duty();
        CREATE TABLE seen_write (robot BIGINT, name TEXT, writer TEXT);
        CREATE FUNCTION see_write() RETURNS trigger LANGUAGE plpgsql AS $$
        BEGIN
            INSERT INTO seen_write VALUES (NEW.robot, TG_ARGV[0], session_user);
            RETURN NULL;
        END $$;",
    );
    for table in TABLES {
        psql(
            url,
            &format!(
                "CREATE TRIGGER write_is_seen AFTER INSERT OR UPDATE ON {table} FOR EACH ROW
                    EXECUTE FUNCTION see_write('{table}')"
            ),
        );
    }
}

/// Returns the instance that has a duty.
pub fn holder(url: &PostgresUrl, duty: &str) -> Option<String> {
    let sql = format!("SELECT coalesce(instance, '') FROM duty WHERE name = '{duty}'");
    let instance = psql(url, &sql).trim().to_owned();
    (!instance.is_empty()).then_some(instance)
}

/// Counts the assignments and withdrawals of robots so far.
pub fn tenures_begun(url: &PostgresUrl) -> usize {
    let count = psql(url, "SELECT count(*) FROM seen_owner");
    count.trim().parse().unwrap()
}

/// Adds the database's records to the evidence.
pub fn read(url: &PostgresUrl, into: &mut Evidence) {
    const COMMITTED: &str = "(extract(epoch FROM pg_xact_commit_timestamp(s.xmin)) * 1e6)::bigint";
    let owners = rows(
        url,
        &format!(
            "SELECT r.id, coalesce(s.instance, ''), s.epoch, {COMMITTED}
            FROM seen_owner AS s JOIN robot AS r ON r.key = s.robot ORDER BY 4, s.n"
        ),
    );
    into.owners = owners
        .into_iter()
        .map(|row| Owned {
            robot: row[0].clone(),
            owner: Some(row[1].clone()).filter(|name| !name.is_empty()),
            epoch: row[2].parse().unwrap(),
            committed_us: row[3].parse().unwrap(),
        })
        .collect();
    let written = rows(
        url,
        &format!(
            "SELECT r.id, s.name, s.writer, {COMMITTED}
            FROM seen_write AS s JOIN robot AS r ON r.key = s.robot"
        ),
    );
    into.written = written
        .into_iter()
        .map(|row| Written {
            robot: row[0].clone(),
            table: row[1].clone(),
            by: row[2].clone(),
            committed_us: row[3].parse().unwrap(),
        })
        .collect();
    let audit = rows(
        url,
        "SELECT id, action, subject || ' ' || subject_id, coalesce(reason, '') FROM audit
        ORDER BY id",
    );
    into.audit = audit
        .into_iter()
        .map(|row| Audited {
            id: row[0].parse().unwrap(),
            action: row[1].clone(),
            subject: row[2].clone(),
            reason: row[3].clone(),
        })
        .collect();
}

/// Returns the alerts that no decision explains and that were raised after the change of this
/// number, each with its course, and the number of the last change now.
pub fn alerts_after(url: &PostgresUrl, change: i64) -> (Vec<String>, i64) {
    const AT: &str = "to_char(to_timestamp(at_ns / 1e9), 'HH24:MI:SS.MS')";
    let raised = format!(
        "SELECT a.kind || ' of ' || a.robot || ':' ||
            (SELECT string_agg(' ' || {AT} || ' ' || h.state || ' ' || h.what, ';' ORDER BY h.id)
            FROM alert_change AS h WHERE h.alert = a.id)
        FROM alert AS a WHERE a.kind <> 'not_applied' AND EXISTS (SELECT FROM alert_change AS c
            WHERE c.alert = a.id AND c.id > {change} AND c.state = 'alerting')"
    );
    let mut raised: Vec<_> = rows(url, &raised)
        .into_iter()
        .map(|row| row.join("|"))
        .collect();
    if !raised.is_empty() {
        let duties = format!(
            "SELECT {AT} || ' ' || name || ' of ' || coalesce(instance, 'nobody') FROM seen_duty ORDER BY n"
        );
        let duties = rows(url, &duties).into_iter().map(|row| row.join("|"));
        raised.extend(duties);
    }
    let last = psql(url, "SELECT coalesce(max(id), 0) FROM alert_change");
    (raised, last.trim().parse().unwrap())
}

fn rows(url: &PostgresUrl, sql: &str) -> Vec<Vec<String>> {
    let told = psql(url, sql);
    let fields = |line: &str| line.split('|').map(str::to_owned).collect();
    told.lines().map(fields).collect()
}
