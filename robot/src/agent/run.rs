//! The agent among its surroundings: performs what [`Agent`] decides.

use std::collections::VecDeque;
use std::time::Duration;

use fleetcal_model::{Generation, RobotTime};
use fleetcal_proto::RobotId;
use fleetcal_proto::calibration::{Applied, AppliedStatus, CalibrationValues};
use fleetcal_proto::signing::TrustedKeys;
use tokio::sync::{mpsc, watch};
use tokio::task::{JoinError, JoinHandle, JoinSet};
use tokio::time::{Instant, MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;
use tracing::{debug, error, info, warn};
use zenoh::liveliness::LivelinessToken;

use super::event::{Activation, Effect, Event, HookAnswer};
use super::file::{AppliedFile, FileError};
use super::hook::{Call, Said, Subject};
use super::link::CalibrationLink;
use super::machine::Agent;
use super::offer::Identity;
use super::options::{AgentError, AgentOptions};
use super::state::{Held, Memory, Phase};
use crate::session::{ClientConfig, at_key, close};
use crate::session_error::SessionError;

/// Interval at which deadlines are checked.
const TICK: Duration = Duration::from_millis(200);
/// Interval at which the service is queried, besides when one appears.
pub(crate) const PULL_PERIOD: Duration = Duration::from_mins(1);

/// Runs a robot's agent until `shutdown` is cancelled, through lost links and without any: a
/// deadline also passes while the service cannot be reached. Needs a tokio runtime with more than
/// one thread, as Zenoh does.
///
/// Returns the generation that the robot holds; 0 for none.
///
/// # Errors
/// The file, its folder or the agent's memory cannot be used, or an endpoint cannot be.
pub async fn run_agent(
    options: AgentOptions,
    shutdown: CancellationToken,
) -> Result<Generation, AgentError> {
    let client = ClientConfig::new(&options.connect)?;
    let mut runner = Runner::start(options)?;
    let stop = shutdown.child_token();
    let trusted = runner.trusted.subscribe();
    let opening = connect(runner.options.clone(), client, trusted, stop.clone());
    let opening = tokio::spawn(opening);
    let ended = runner.run(opening, &shutdown).await;
    stop.cancel();
    if let Some(connected) = runner.connected {
        close(&connected.session).await;
    }
    ended.map(|()| runner.agent.memory().held.generation)
}

/// An open session, with its declarations.
#[derive(Debug)]
struct Connected {
    session: zenoh::Session,
    link: CalibrationLink,
    /// Token, present while it lives.
    _token: Option<LivelinessToken>,
}

type Opening = Result<Option<(Connected, mpsc::Receiver<Event>)>, SessionError>;

async fn connect(
    options: AgentOptions,
    client: ClientConfig,
    trusted: watch::Receiver<TrustedKeys>,
    stop: CancellationToken,
) -> Opening {
    let AgentOptions { robot, keys, .. } = &options;
    let Some(session) = client.open(robot, &stop).await? else {
        return Ok(None);
    };
    let (link, incoming) = CalibrationLink::declare(&session, keys, robot, Some(trusted)).await?;
    let mut token = None;
    if options.holds_alive_token {
        let alive = keys.alive(robot);
        let declared = session.liveliness().declare_token(alive.clone()).await;
        token = Some(declared.map_err(at_key(&alive))?);
    }
    let connected = Connected {
        session,
        link,
        _token: token,
    };
    Ok(Some((connected, incoming)))
}

/// Performer of effects, in their order.
struct Runner {
    options: AgentOptions,
    agent: Agent,
    /// Keys that the agent trusts, for the link.
    trusted: watch::Sender<TrustedKeys>,
    file: AppliedFile,
    /// Content of the memory's file.
    remembered: Option<Memory>,
    started: Instant,
    connected: Option<Connected>,
    /// The running hook: the agent waits for its result before it calls it again.
    hook: JoinSet<HookEnd>,
    logged: Option<Applied>,
}

/// Purpose of the hook's call, and its result.
type HookEnd = (Call, Said);

impl Runner {
    /// Opens the file and the memory beside it.
    fn start(options: AgentOptions) -> Result<Self, AgentError> {
        let file = AppliedFile::open(&options.apply)?;
        options.outputs.check(&file.own())?;
        let remembered = file.memory(&options.robot)?;
        let memory = match &remembered {
            Some(memory) => memory.clone(),
            None => first_memory(&options.robot, &file, options.start_ns)?,
        };
        // Written at once: a folder that cannot be written shows now, not at the first approval.
        file.remember(&memory)?;
        let identity = Identity {
            robot: options.robot.clone(),
            trusted: options.trusted.clone(),
            limits: options.limits,
        };
        let agent = Agent::new(identity, memory.clone());
        Ok(Self {
            trusted: watch::Sender::new(agent.trusted().clone()),
            agent,
            remembered: Some(memory),
            file,
            started: Instant::now(),
            connected: None,
            hook: JoinSet::new(),
            logged: None,
            options,
        })
    }

    /// Returns the wall time at the start plus the elapsed time: a clock that is set moves no
    /// deadline.
    fn now(&self) -> RobotTime {
        self.options.start_ns.plus(self.started.elapsed())
    }

    async fn run(
        &mut self,
        mut opening: JoinHandle<Opening>,
        stop: &CancellationToken,
    ) -> Result<(), AgentError> {
        let mut tick = interval(TICK);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut pull = interval(PULL_PERIOD);
        pull.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut incoming: Option<mpsc::Receiver<Event>> = None;
        let written = self.is_written()?;
        // What a killed agent had written into the one file and not into the others.
        self.write_outputs()?;
        self.take(Event::Restarted { written }).await?;
        loop {
            // In this order: no flood of messages may hold a deadline off.
            tokio::select! {
                biased;
                () = stop.cancelled() => return Ok(()),
                _ = tick.tick() => self.take(Event::Tick).await?,
                Some(ended) = self.hook.join_next() => self.hook_ended(ended).await?,
                _ = pull.tick() => self.pull().await,
                opened = &mut opening, if incoming.is_none() => {
                    let Some((connected, receiver)) = opened.map_err(SessionError::from)?? else {
                        return Ok(());
                    };
                    incoming = Some(receiver);
                    self.connected = Some(connected);
                    info!(robot.id = %self.options.robot, "connected");
                    self.pull().await;
                }
                Some(event) = next(incoming.as_mut()) => {
                    let is_service = event == Event::ServiceUp;
                    self.take(event).await?;
                    if is_service {
                        self.pull().await;
                    }
                }
            }
        }
    }

    /// True if the file holds the values that were about to be written when the process ended.
    fn is_written(&self) -> Result<bool, AgentError> {
        let (Phase::Writing { offer, .. } | Phase::Activating { offer, .. }) =
            &self.agent.memory().phase
        else {
            return Ok(false);
        };
        let text = self.file.text_of(&offer.values)?;
        Ok(self.file.read()?.as_deref() == Some(text.as_str()))
    }

    /// Passes an event to the agent and performs its effects.
    async fn take(&mut self, event: Event) -> Result<(), AgentError> {
        let mut events = VecDeque::from([event]);
        while let Some(event) = events.pop_front() {
            let effects = self.agent.step(event, self.now())?;
            let is_remembered = self.remember();
            follow(&self.trusted, &self.agent);
            for effect in effects {
                events.extend(self.perform(effect, is_remembered).await);
            }
        }
        Ok(())
    }

    /// Stores the memory if it has changed. A failed write is repeated with the next event; until
    /// then no values are written.
    fn remember(&mut self) -> bool {
        let memory = self.agent.memory();
        if self.remembered.as_ref() == Some(memory) {
            return true;
        }
        match self.file.remember(memory) {
            Ok(()) => {
                self.remembered = Some(memory.clone());
                true
            }
            Err(error) => {
                error!(robot.id = %self.options.robot, %error, "the agent's memory is not written");
                false
            }
        }
    }

    async fn perform(&mut self, effect: Effect, is_remembered: bool) -> Option<Event> {
        match effect {
            Effect::AskHook(offer) => {
                return self.call_hook(Call::Check, offer.generation, offer.document);
            }
            Effect::Write(_) if !is_remembered => {
                let reason = "the agent's memory cannot be written".to_owned();
                return Some(Event::Written(Err(reason)));
            }
            Effect::Write(values) => return Some(Event::Written(self.write(&values))),
            Effect::Restore(fallback) => {
                let restored = self.file.restore(fallback.file.as_deref());
                let restored = restored.and_then(|()| self.write_outputs());
                return Some(Event::Restored(restored.map_err(|error| error.to_string())));
            }
            Effect::Activate(offer) => {
                return self.call_hook(Call::Applied, offer.generation, offer.document);
            }
            Effect::TellReverted(ending) => {
                return self.call_hook(Call::Reverted, ending.generation, ending.document);
            }
            Effect::Acknowledge(answer) => self.acknowledge(&answer).await,
            Effect::AskConfirmed => {
                if let Some(Connected { link, .. }) = &self.connected {
                    complain(link.ask_confirmed().await);
                }
            }
            Effect::Pull => self.pull().await,
            Effect::Note(note) => warn!(robot.id = %self.options.robot, "{note}"),
        }
        None
    }

    fn write(&self, values: &CalibrationValues) -> Result<(), String> {
        let written = self
            .file
            .text_of(values)
            .and_then(|text| self.file.write(&text))
            .and_then(|()| self.write_outputs());
        written.map_err(|error| error.to_string())
    }

    /// Writes the content of the applied file to the files beside it.
    fn write_outputs(&self) -> Result<(), FileError> {
        if self.options.outputs.files.is_empty() {
            return Ok(());
        }
        let text = self.file.read()?;
        let values = text.as_deref().and_then(|text| self.file.values_in(text));
        let beside = self.agent.memory().beside_values();
        self.options.outputs.write(values.as_ref(), &beside)
    }

    /// Calls the hook, whose result comes as an event. A robot without a hook accepts everything.
    fn call_hook(&mut self, call: Call, generation: Generation, document: String) -> Option<Event> {
        let Some(hook) = self.options.hook.clone() else {
            return Some(self.answered(call, Said::Yes));
        };
        let subject = Subject {
            robot: self.options.robot.clone(),
            generation,
            document,
            file: self.file.path().to_owned(),
        };
        self.hook
            .spawn(async move { (call, hook.call(call, subject).await) });
        None
    }

    async fn hook_ended(&mut self, ended: Result<HookEnd, JoinError>) -> Result<(), AgentError> {
        let (call, said) = match (ended, &self.agent.memory().phase) {
            (Ok(ended), _) => ended,
            (Err(error), phase) => {
                let call = match phase {
                    Phase::Asking { .. } => Call::Check,
                    Phase::Activating { .. } => Call::Applied,
                    _ => Call::Reverted,
                };
                (call, Said::Failed(format!("hook: {error}")))
            }
        };
        let event = self.answered(call, said);
        self.take(event).await
    }

    fn answered(&self, call: Call, said: Said) -> Event {
        if said == Said::Busy {
            info!(robot.id = %self.options.robot, "busy: a calibration waits");
        }
        match call {
            Call::Check => Event::HookAnswered(match said {
                Said::Yes => self.go(),
                Said::Busy => HookAnswer::Busy,
                Said::Failed(reason) => HookAnswer::Failed(reason),
            }),
            Call::Applied => Event::Activated(match said {
                Said::Yes => Activation::Done,
                Said::Busy => Activation::Busy,
                Said::Failed(reason) => Activation::Failed(reason),
            }),
            Call::Reverted => Event::RevertTold(match said {
                Said::Yes => Ok(()),
                Said::Busy => Err("the hook says that the robot is busy".to_owned()),
                Said::Failed(reason) => Err(reason),
            }),
        }
    }

    /// Returns the go-ahead with the present content of the file.
    fn go(&self) -> HookAnswer {
        match self.file.read() {
            Ok(before) => HookAnswer::Go { before },
            Err(error) => HookAnswer::Failed(error.to_string()),
        }
    }

    async fn acknowledge(&mut self, answer: &Applied) {
        if self.logged.as_ref() != Some(answer) {
            log(&self.options.robot, answer);
            self.logged = Some(answer.clone());
        }
        if let Some(Connected { link, .. }) = &self.connected {
            complain(link.acknowledge(answer).await);
        }
    }

    async fn pull(&self) {
        if let Some(Connected { link, .. }) = &self.connected {
            complain(link.ask_confirmed().await);
            complain(link.ask_approved().await);
        }
    }
}

/// Makes the memory of an agent's first start, with the values that the robot was tuned to by hand.
fn first_memory(robot: &RobotId, file: &AppliedFile, now: RobotTime) -> Result<Memory, AgentError> {
    let text = file.read()?;
    let values = text.as_deref().and_then(|text| file.values_in(text));
    if text.is_some() && values.is_none() {
        let file = file.path().display();
        warn!(robot.id = %robot, %file, "says something else than calibration values: approved ones will replace it as a whole");
    }
    let held = Held::factory(values, now);
    Ok(Memory::new(robot.clone(), held))
}

/// Passes the keys that the agent trusts on to its link.
pub(crate) fn follow(trusted: &watch::Sender<TrustedKeys>, agent: &Agent) {
    trusted.send_if_modified(|known| {
        let is_new = known != agent.trusted();
        if is_new {
            known.clone_from(agent.trusted());
        }
        is_new
    });
}

async fn next(incoming: Option<&mut mpsc::Receiver<Event>>) -> Option<Event> {
    match incoming {
        Some(incoming) => incoming.recv().await,
        None => std::future::pending().await,
    }
}

/// Logs a failed message, which is repeated until it is confirmed, or queried again with the next
/// pull.
fn complain(sent: Result<(), SessionError>) {
    if let Err(error) = sent {
        debug!(%error, "not sent");
    }
}

fn log(robot: &RobotId, answer: &Applied) {
    let Applied {
        generation, reason, ..
    } = answer;
    let reason = reason.as_deref().unwrap_or_default();
    match answer.status {
        AppliedStatus::Applied => info!(robot.id = %robot, %generation, "calibration in use"),
        status => warn!(robot.id = %robot, %generation, ?status, reason, "calibration not in use"),
    }
}
