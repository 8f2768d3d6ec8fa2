//! The robot's own say: a program that is asked before values are written, and told when they were
//! written and when they went.

use std::path::PathBuf;
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use fleetcal_model::Generation;
use fleetcal_proto::RobotId;
use rustix::process::{Pid, Signal, kill_process_group};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::process::{Child, ChildStderr, ChildStdin, Command};
use tracing::debug;

/// Exit status by which a hook reports that the robot is on a mission (`EX_TEMPFAIL` of
/// `sysexits.h`).
pub const EXIT_BUSY: i32 = 75;
/// Kept length of a hook's standard error, bytes.
const STDERR_BYTES_MAX: u64 = 1024;
/// Wait for the rest of a hook's standard error after its end: a process that it left running may
/// hold that open for ever.
const STDERR_LINGER: Duration = Duration::from_millis(100);

/// A program on the robot, called without a shell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hook {
    /// The program: a path, or a name that is looked up in `PATH`.
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<String>,
    /// Time after which it is killed, with everything it started.
    pub timeout: Duration,
}

/// Purpose of a hook's call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Call {
    /// Query: may this document be applied now?
    Check,
    /// This document's values are written.
    Applied,
    /// This document's values are withdrawn, and the former ones restored.
    Reverted,
}

impl Call {
    fn name(self) -> &'static str {
        match self {
            Self::Check => "check",
            Self::Applied => "applied",
            Self::Reverted => "reverted",
        }
    }
}

/// Result of a hook's call.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Said {
    Yes,
    Busy,
    Failed(String),
}

/// Subject of a call.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Subject {
    pub robot: RobotId,
    pub generation: Generation,
    /// Exact text of the document, which the hook receives on its standard input.
    pub document: String,
    /// The file that the values are written to.
    pub file: PathBuf,
}

impl Hook {
    /// Calls the hook, and waits for its result.
    pub(super) async fn call(&self, call: Call, subject: Subject) -> Said {
        let spawned = Command::new(&self.program)
            .args(&self.arguments)
            .env("FLEETCAL_CALL", call.name())
            .env("FLEETCAL_ROBOT", subject.robot.as_str())
            .env("FLEETCAL_GENERATION", subject.generation.to_string())
            .env("FLEETCAL_FILE", &subject.file)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .process_group(0)
            .kill_on_drop(true)
            .spawn();
        let program = self.program.display();
        let child = match spawned {
            Ok(child) => child,
            Err(error) => {
                return Said::Failed(format!("hook {program} cannot be started: {error}"));
            }
        };
        let group = child.id();
        let attended = tokio::time::timeout(self.timeout, attend(child, subject.document)).await;
        match attended {
            Err(_) => {
                kill_group(group);
                let timeout_s = self.timeout.as_secs_f64();
                Said::Failed(format!(
                    "hook took longer than {timeout_s} s and was killed"
                ))
            }
            Ok(Err(error)) => Said::Failed(format!("hook {program}: {error}")),
            Ok(Ok((status, stderr))) => said(status, stderr.trim()),
        }
    }
}

fn kill_group(id: Option<u32>) {
    let group = id
        .and_then(|id| i32::try_from(id).ok())
        .and_then(Pid::from_raw);
    if let Some(group) = group
        && let Err(error) = kill_process_group(group, Signal::KILL)
    {
        debug!(%error, "nothing of the hook was left");
    }
}

fn said(status: ExitStatus, stderr: &str) -> Said {
    match status.code() {
        Some(0) => Said::Yes,
        Some(EXIT_BUSY) => Said::Busy,
        _ if stderr.is_empty() => Said::Failed(format!("hook ended with {status}")),
        _ => Said::Failed(format!("hook ended with {status}: {stderr}")),
    }
}

async fn attend(mut child: Child, document: String) -> std::io::Result<(ExitStatus, String)> {
    let mut stderr = Vec::new();
    let talk = talk(
        child.stdin.take(),
        document,
        child.stderr.take(),
        &mut stderr,
    );
    let mut talk = Box::pin(talk);
    let mut talked = false;
    let status = loop {
        tokio::select! {
            status = child.wait() => break status?,
            () = &mut talk, if !talked => talked = true,
        }
    };
    if !talked
        && tokio::time::timeout(STDERR_LINGER, &mut talk)
            .await
            .is_err()
    {
        debug!("something that the hook started holds its pipes");
    }
    drop(talk);
    Ok((status, String::from_utf8_lossy(&stderr).into_owned()))
}

/// Feeds a hook the document, which it need not read, and keeps the beginning of its standard
/// error.
async fn talk(
    stdin: Option<ChildStdin>,
    document: String,
    stderr: Option<ChildStderr>,
    said: &mut Vec<u8>,
) {
    let feed = async {
        if let Some(mut stdin) = stdin {
            stdin.write_all(document.as_bytes()).await?;
        }
        Ok::<_, std::io::Error>(())
    };
    let listen = async {
        if let Some(mut stderr) = stderr {
            (&mut stderr)
                .take(STDERR_BYTES_MAX)
                .read_to_end(said)
                .await?;
            // The rest is read too, or the hook would wait for room.
            tokio::io::copy(&mut stderr, &mut tokio::io::sink()).await?;
        }
        Ok::<_, std::io::Error>(())
    };
    let (fed, listened) = tokio::join!(feed, listen);
    for error in [fed.err(), listened.err()].into_iter().flatten() {
        debug!(%error, "a pipe to the hook broke");
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// Wait that suffices for anything that ends by itself.
    const PATIENCE: Duration = Duration::from_secs(30);

    fn shell(script: &str, timeout: Duration) -> Hook {
        Hook {
            program: "sh".into(),
            arguments: ["-c", script].map(str::to_owned).to_vec(),
            timeout,
        }
    }

    async fn call(hook: &Hook) -> Said {
        let subject = Subject {
            robot: RobotId::parse("tugger_01").unwrap(),
            generation: Generation(4),
            document: "x".repeat(100_000),
            file: "/etc/calibration.yaml".into(),
        };
        hook.call(Call::Check, subject).await
    }

    async fn ask(script: &str, timeout: Duration) -> Said {
        call(&shell(script, timeout)).await
    }

    #[tokio::test]
    async fn the_exit_status_is_the_answer() {
        assert_eq!(ask("true", PATIENCE).await, Said::Yes);
        assert_eq!(ask("cat > /dev/null; exit 75", PATIENCE).await, Said::Busy);
        let all_given = "test \"$FLEETCAL_CALL $FLEETCAL_ROBOT $FLEETCAL_GENERATION $FLEETCAL_FILE \
                         $(wc -c | tr -d ' ')\" = \
                         'check tugger_01 4 /etc/calibration.yaml 100000'";
        assert_eq!(ask(all_given, PATIENCE).await, Said::Yes);
        let cases = [
            ("echo no room >&2; exit 3", "exit status: 3: no room"),
            ("kill -9 $$", "signal: 9"),
            (
                "head -c 1000000 /dev/zero | tr '\\0' y >&2; exit 1",
                "exit status: 1: y",
            ),
        ];
        for (script, wanted) in cases {
            let Said::Failed(reason) = ask(script, PATIENCE).await else {
                panic!("{script} did not fail");
            };
            assert!(reason.contains(wanted) && reason.len() < 1200, "{reason}");
        }
    }

    #[tokio::test]
    async fn no_shell_reads_the_program_or_its_arguments() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a; touch $HOME");
        let hook = Hook {
            program: "touch".into(),
            arguments: vec![file.to_str().unwrap().to_owned()],
            timeout: PATIENCE,
        };
        assert_eq!(call(&hook).await, Said::Yes);
        assert!(file.is_file());
        let missing = Hook {
            program: "/nowhere/hook --now".into(),
            ..hook
        };
        let Said::Failed(reason) = call(&missing).await else {
            panic!("it ran");
        };
        assert!(
            reason.contains("/nowhere/hook --now cannot be started"),
            "{reason}"
        );
    }

    #[tokio::test]
    async fn a_hook_that_hangs_is_killed_with_what_it_started() {
        let folder = tempfile::tempdir().unwrap();
        let pid_file = folder.path().join("pid");
        let script = format!("sleep 1000 & echo $! > {}; wait", pid_file.display());
        let Said::Failed(reason) = ask(&script, Duration::from_secs(1)).await else {
            panic!("it did not fail");
        };
        assert_eq!(reason, "hook took longer than 1 s and was killed");
        let pid = fs::read_to_string(pid_file).unwrap();
        let is_running = || {
            let stat = fs::read_to_string(format!("/proc/{}/stat", pid.trim()));
            // A zombie that nobody has buried yet has gone, too.
            stat.is_ok_and(|stat| !stat.contains(") Z "))
        };
        let gone = tokio::time::timeout(PATIENCE, async {
            while is_running() {
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        });
        gone.await.unwrap();
    }

    #[tokio::test]
    async fn what_a_hook_leaves_running_is_not_waited_for() {
        let asked = ask("sleep 60 & exit 75", PATIENCE);
        assert_eq!(asked.await, Said::Busy);
    }
}
