//! The agent with its file, over a real router.

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use fleetcal_model::{Generation, Pose2, RobotTime};
use fleetcal_patience::until;
use fleetcal_proto::Keys;
use fleetcal_proto::calibration::{AppliedStatus, Envelope};
use fleetcal_proto::signing::seal;
use tempfile::TempDir;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::service::{Link, Service, free_endpoint};
use super::*;
use crate::agent::{AgentError, AgentOptions, Hook, OutputKind, Outputs, Phase, Rest, run_agent};

pub(super) const BY_HAND: &str =
    "# by hand\nsteering_offset_rad: 0.01\nlidar_x_m: 0.4\nlidar_y_m: 0\nlidar_yaw_rad: 0.0\n";

fn shell(script: String) -> Hook {
    Hook {
        program: "sh".into(),
        arguments: vec!["-c".to_owned(), script],
        timeout: Duration::from_secs(30),
    }
}

/// A robot's disk, and the agent that runs on it.
pub(super) struct Robot {
    folder: TempDir,
    pub(super) options: AgentOptions,
    running: Option<(
        CancellationToken,
        JoinHandle<Result<Generation, AgentError>>,
    )>,
}

impl Robot {
    pub fn new(endpoint: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let options = AgentOptions {
            outputs: Outputs::default(),
            robot: robot(),
            connect: vec![endpoint.to_owned()].into(),
            keys: Keys::default(),
            apply: folder.path().join("calibration.yaml"),
            trusted: key().public_key().into(),
            limits: identity().limits,
            hook: None,
            holds_alive_token: false,
            start_ns: RobotTime(START_NS),
        };
        Self {
            folder,
            options,
            running: None,
        }
    }

    /// Adds a hook that records its calls and is busy while a file `busy_` and the call's name
    /// exists.
    pub(super) fn with_hook(mut self) -> Self {
        let folder = self.folder.path().display();
        self.options.hook = Some(shell(format!(
            "cat > {folder}/last_document; echo $FLEETCAL_CALL $FLEETCAL_GENERATION >> {folder}/calls; \
             test ! -e {folder}/busy_$FLEETCAL_CALL || exit 75"
        )));
        self
    }

    pub fn start(&mut self) {
        let stop = CancellationToken::new();
        let task = tokio::spawn(run_agent(self.options.clone(), stop.clone()));
        self.running = Some((stop, task));
    }

    pub async fn stop(&mut self) -> u64 {
        let (stop, task) = self.running.take().unwrap();
        stop.cancel();
        task.await.unwrap().unwrap().0
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(super) fn file(&self) -> String {
        fs::read_to_string(&self.options.apply).unwrap_or_default()
    }

    /// True if the parameters for ROS have this steering offset.
    fn tells_ros(&self, offset_rad: f64) -> bool {
        let text = fs::read_to_string(self.path("ros.yaml")).unwrap_or_default();
        text.contains(&format!("steering_offset_rad: {offset_rad:.9}\n"))
    }

    pub(super) fn calls(&self) -> Vec<String> {
        let calls = fs::read_to_string(self.path("calls")).unwrap_or_default();
        calls.lines().map(str::to_owned).collect()
    }

    pub(super) fn memory(&self) -> Memory {
        let path = self.path("calibration.yaml.agent.json");
        serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
    }

    pub async fn settles(&self) {
        let settled = Phase::Resting(Rest::Settled);
        until("it is settled", || self.memory().phase == settled).await;
    }

    pub(super) fn remember(&self, memory: &Memory) {
        let text = serde_json::to_string(memory).unwrap();
        fs::write(self.path("calibration.yaml.agent.json"), text).unwrap();
    }
}

pub(super) fn text_of(generation: u64) -> String {
    let offset_rad = values(generation).steering_offset_rad;
    format!(
        "steering_offset_rad: {offset_rad}\nlidar_x_m: 0.434\nlidar_y_m: -0.016\n\
         lidar_yaw_rad: 0.0133\nspeed_scale: 1.002\n"
    )
}

fn with_deadline(generation: u64, confirm_within_s: u32) -> Envelope {
    let mut document = document(generation);
    document.confirm_within_s = confirm_within_s;
    sealed(&document)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_that_was_off_takes_the_newest_when_it_starts() {
    let service = Service::start().await;
    service.approve(&sealed(&document(3))).await;
    service.approve(&sealed(&document(4))).await;
    let mut robot = Robot::new(&service.endpoint).with_hook();
    fs::write(&robot.options.apply, BY_HAND).unwrap();
    robot.options.start_ns = RobotTime(START_NS + 3600 * SECOND_NS);
    robot.start();
    let applied = service.wait_for(4, AppliedStatus::Applied).await;
    assert_eq!(applied.sha256, sealed(&document(4)).sha256);
    assert_eq!(applied.values, Some(values(4)));
    assert!((3600..3640).contains(&(applied.applied_at_ns.whole_s() - START_NS / SECOND_NS)));
    assert_eq!(robot.file(), text_of(4));
    let by_hand = service.answer_on(0, AppliedStatus::Applied).unwrap();
    assert!((by_hand.values.unwrap().steering_offset_rad - 0.01).abs() < 1e-12);
    robot.settles().await;
    assert_eq!(robot.stop().await, 4);
    assert_eq!(robot.calls(), ["check 4", "applied 4"]);
    let document_seen = fs::read_to_string(robot.path("last_document")).unwrap();
    assert_eq!(document_seen, sealed(&document(4)).document);

    // Started again it says what it holds, and applies nothing twice.
    let said = service.answers().len();
    robot.start();
    until("it says what it holds", || service.answers().len() > said).await;
    service.approve(&sealed(&document(4))).await;
    service.approve(&sealed(&document(5))).await;
    service.wait_for(5, AppliedStatus::Applied).await;
    assert_eq!(robot.stop().await, 5);
    assert_eq!(
        robot.calls(),
        ["check 4", "applied 4", "check 5", "applied 5"]
    );
    assert!(service.answer_on(3, AppliedStatus::Applied).is_none());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_document_says_where_base_link_is_and_a_restart_remembers_it() {
    let service = Service::start().await;
    let mut document = document(1);
    document.rear_axle_in_base_link = Some(Pose2 {
        x_m: -0.4,
        y_m: 0.0,
        yaw_rad: 0.0,
    });
    service.approve(&sealed(&document)).await;
    let mut robot = Robot::new(&service.endpoint);
    let output = robot.path("lidar.xacro");
    robot.options.outputs.files = vec![(OutputKind::UrdfOrigin, output.clone())];
    robot.start();
    service.wait_for(1, AppliedStatus::Applied).await;
    robot.settles().await;
    let origin = "xyz=\"0.034000 -0.016000 0.000000\"";
    let says = || fs::read_to_string(&output).is_ok_and(|text| text.contains(origin));
    assert!(says());
    assert_eq!(robot.stop().await, 1);
    fs::remove_file(&output).unwrap();
    robot.options.connect = vec![free_endpoint()].into();
    robot.start();
    until("it is written again", says).await;
    assert_eq!(robot.stop().await, 1);

    document.generation = Generation(2);
    document.base_generation = Some(Generation(1));
    document.rear_axle_in_base_link = Some(Pose2 {
        x_m: 31.0,
        y_m: 0.0,
        yaw_rad: 0.0,
    });
    service.approve(&sealed(&document)).await;
    robot.options.connect = vec![service.endpoint.clone()].into();
    robot.start();
    let refused = service.wait_for(2, AppliedStatus::Refused).await;
    let reason = refused.reason.unwrap();
    assert!(
        reason.contains("rear_axle_in_base_link: got 31"),
        "{reason}"
    );
    assert_eq!(robot.stop().await, 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_asks_again_when_a_service_comes_up() {
    let mut service = Service::router(free_endpoint()).await;
    service.confirms(true);
    let mut robot = Robot::new(&service.endpoint);
    robot.options.holds_alive_token = true;
    robot.start();
    service.wait_for_robot().await;
    for generation in [1, 2] {
        service.store(&sealed(&document(generation)));
        service.serve().await;
        service.wait_for(generation, AppliedStatus::Applied).await;
        service.leave().await;
    }
    assert_eq!(robot.stop().await, 2);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_gets_what_was_approved_while_its_link_was_cut() {
    let service = Service::start().await;
    let mut link = Link::to(&service.endpoint).await;
    let mut robot = Robot::new(&link.endpoint).with_hook();
    robot.start();
    service.approve(&sealed(&document(1))).await;
    service.wait_for(1, AppliedStatus::Applied).await;
    link.cut().await;
    service.approve(&sealed(&document(2))).await;
    service.approve(&sealed(&document(3))).await;
    tokio::time::sleep(Duration::from_secs(2)).await;
    assert_eq!(robot.file(), text_of(1));
    link.mend().await;
    service.wait_for(3, AppliedStatus::Applied).await;
    robot.settles().await;
    assert_eq!(robot.stop().await, 3);
    assert_eq!(
        robot.calls(),
        ["check 1", "applied 1", "check 3", "applied 3"]
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_deadline_passes_while_the_link_is_cut() {
    let service = Service::start().await;
    let mut link = Link::to(&service.endpoint).await;
    let mut robot = Robot::new(&link.endpoint).with_hook();
    let for_ros = robot.path("ros.yaml");
    robot.options.outputs.files = vec![(OutputKind::RosParameters, for_ros)];
    fs::write(&robot.options.apply, BY_HAND).unwrap();
    robot.start();
    service.confirms(false);
    service.approve(&with_deadline(1, 2)).await;
    until("it is applied", || robot.file() == text_of(1)).await;
    let offset_rad = values(1).steering_offset_rad;
    until("ROS has it too", || robot.tells_ros(offset_rad)).await;
    link.cut().await;
    until("it goes back by itself", || robot.file() == BY_HAND).await;
    until("ROS goes back too", || robot.tells_ros(0.01)).await;
    until("the hook was told", || {
        robot.calls() == ["check 1", "applied 1", "reverted 1"]
    })
    .await;
    link.mend().await;
    let reverted = service.wait_for(1, AppliedStatus::Reverted).await;
    assert_eq!(reverted.reason.unwrap(), "no confirmation within 2 s");
    assert!((reverted.values.unwrap().steering_offset_rad - 0.01).abs() < 1e-12);
    // What is still offered is not taken a second time, but the next one is.
    service.confirms(true);
    service.approve(&with_deadline(1, 2)).await;
    service.approve(&sealed(&document(2))).await;
    service.wait_for(2, AppliedStatus::Applied).await;
    assert_eq!(robot.stop().await, 2);
    assert_eq!(
        robot.calls(),
        ["check 1", "applied 1", "reverted 1", "check 2", "applied 2"]
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_confirmed_stays_and_what_is_not_goes() {
    let service = Service::start().await;
    let mut robot = Robot::new(&service.endpoint);
    robot.start();
    service.wait_for_robot().await;
    service.approve(&with_deadline(1, 1)).await;
    service.wait_for(1, AppliedStatus::Applied).await;
    tokio::time::sleep(Duration::from_millis(2500)).await;
    assert_eq!(robot.file(), text_of(1));
    assert!(service.answer_on(1, AppliedStatus::Reverted).is_none());

    service.confirms(false);
    service.approve(&with_deadline(2, 1)).await;
    service.wait_for(2, AppliedStatus::Reverted).await;
    assert_eq!(robot.file(), text_of(1));
    assert_eq!(robot.stop().await, 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_must_not_be_applied_is_refused_with_its_reason() {
    let service = Service::start().await;
    let mut robot = Robot::new(&service.endpoint);
    robot.start();
    service.wait_for_robot().await;
    service.approve(&sealed(&document(3))).await;
    service.wait_for(3, AppliedStatus::Applied).await;
    robot.settles().await;

    let good = sealed(&document(7));
    let altered = Envelope {
        document: good.document.replace("\"ana\"", "\"eve\""),
        ..good.clone()
    };
    let mut beyond = document(8);
    beyond.values.lidar_y_m = 2.0;
    let mut stale_base = document(9);
    stale_base.base_generation = None;
    let cases = [
        (altered, 7, "the document's is"),
        (
            seal(&document(6), &strange_key()).unwrap(),
            6,
            "key_id: got",
        ),
        (
            Envelope {
                signature: sealed(&document(1)).signature,
                ..sealed(&document(5))
            },
            5,
            "signature: another one",
        ),
        (
            sealed(&document(2)),
            2,
            "generation: got 2, expected higher ones than 3",
        ),
        (
            sealed(&beyond),
            8,
            "values.lidar_y_m: got 2, expected -1.5 to 1.5 on this robot",
        ),
        (
            sealed(&stale_base),
            9,
            "base_generation: got none, expected 3",
        ),
    ];
    service.push(b"{\"document\": 1}".to_vec()).await;
    for (envelope, generation, reason) in cases {
        service.approve(&envelope).await;
        let refused = service.wait_for(generation, AppliedStatus::Refused).await;
        assert_eq!(refused.sha256, envelope.sha256);
        let said = refused.reason.unwrap();
        assert!(said.contains(reason), "{said}");
        assert_eq!(refused.values, Some(values(3)), "what it goes on with");
    }
    assert_eq!(robot.file(), text_of(3));
    assert_eq!(robot.stop().await, 3);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_robot_on_a_mission_is_asked_again() {
    let mut service = Service::start().await;
    let mut robot = Robot::new(&service.endpoint).with_hook();
    fs::write(robot.path("busy_check"), "").unwrap();
    robot.start();
    service.wait_for_robot().await;
    service.approve(&sealed(&document(1))).await;
    until("the hook was asked", || !robot.calls().is_empty()).await;
    tokio::time::sleep(Duration::from_millis(500)).await;
    assert_eq!(robot.file(), "");
    assert!(service.answers().is_empty(), "{:?}", service.answers());
    fs::remove_file(robot.path("busy_check")).unwrap();
    service.leave().await;
    service.serve().await;
    service.wait_for(1, AppliedStatus::Applied).await;
    assert_eq!(robot.stop().await, 1);

    robot.options.hook = Some(shell("echo brakes are off >&2; exit 1".to_owned()));
    robot.start();
    service.approve(&sealed(&document(2))).await;
    let failed = service.wait_for(2, AppliedStatus::Failed).await;
    assert_eq!(
        failed.reason.unwrap(),
        "hook ended with exit status: 1: brakes are off"
    );
    assert_eq!(robot.stop().await, 1);
    assert_eq!(robot.file(), text_of(1));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_the_robots_software_cannot_work_with_is_taken_back() {
    let mut service = Service::start().await;
    let mut robot = Robot::new(&service.endpoint).with_hook();
    fs::write(&robot.options.apply, BY_HAND).unwrap();
    // A mission begins between the question and the writing.
    fs::write(robot.path("busy_applied"), "").unwrap();
    robot.start();
    service.wait_for_robot().await;
    service.approve(&sealed(&document(1))).await;
    // Asked again a while later, it is told of all three again.
    until("the hook was told twice", || robot.calls().len() >= 3).await;
    assert_eq!(robot.calls()[..3], ["check 1", "applied 1", "reverted 1"]);
    robot.settles().await;
    assert_eq!(robot.file(), BY_HAND);
    assert!(service.answer_on(1, AppliedStatus::Failed).is_none());
    fs::remove_file(robot.path("busy_applied")).unwrap();
    service.leave().await;
    service.serve().await;
    service.wait_for(1, AppliedStatus::Applied).await;
    robot.settles().await;
    robot.stop().await;

    robot.options.hook = Some(shell(
        "test $FLEETCAL_CALL = check || { echo no $FLEETCAL_CALL >&2; exit 1; }".to_owned(),
    ));
    robot.start();
    service.approve(&sealed(&document(2))).await;
    let failed = service.wait_for(2, AppliedStatus::Failed).await;
    let said = failed.reason.unwrap();
    assert!(
        said.contains("no applied") && said.contains("but hook ended"),
        "{said}"
    );
    assert_eq!(failed.values, Some(values(1)));
    assert_eq!(robot.file(), text_of(1));
    assert_eq!(robot.stop().await, 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_cannot_be_written_is_acknowledged_as_failed() {
    let service = Service::start().await;
    let mut robot = Robot::new(&service.endpoint);
    robot.start();
    service.wait_for_robot().await;
    // A folder in the file's place: it cannot be replaced by a file.
    fs::create_dir(&robot.options.apply).unwrap();
    service.approve(&sealed(&document(1))).await;
    let failed = service.wait_for(1, AppliedStatus::Failed).await;
    let reason = failed.reason.unwrap();
    assert!(reason.contains("calibration.yaml"), "{reason}");
    fs::remove_dir(&robot.options.apply).unwrap();
    service.approve(&sealed(&document(2))).await;
    service.wait_for(2, AppliedStatus::Applied).await;
    assert_eq!(robot.stop().await, 2);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_agent_that_cannot_work_says_why_at_once() {
    let mut robot = Robot::new(&free_endpoint());
    robot.options.apply = robot.path("none/calibration.yaml");
    let refused = |options: AgentOptions| async move {
        let error = run_agent(options, CancellationToken::new())
            .await
            .unwrap_err();
        (error.exit_status(), error.to_string())
    };
    let (status, sentence) = refused(robot.options.clone()).await;
    assert!(
        status == 74 && sentence.contains("none/calibration.yaml"),
        "{sentence}"
    );
    robot.options.apply = robot.path("calibration.ini");
    let (status, sentence) = refused(robot.options.clone()).await;
    assert!(
        status == 2 && sentence.contains("calibration.ini"),
        "{sentence}"
    );
    robot.options.apply = robot.path("calibration.yaml");
    robot.options.connect = vec!["nonsense".to_owned()].into();
    let (status, sentence) = refused(robot.options.clone()).await;
    assert!(status == 2 && sentence.contains("nonsense"), "{sentence}");
}
