//! `fleetcal replay`: streams a recording over Zenoh as its robot would.

use std::path::PathBuf;

use clap::Args;
use fleetcal_proto::{KeyRoot, Keys, RobotId};
use fleetcal_robot::replay::{Rate, ReplayOptions, ReplaySummary, replay};

use crate::connection::ConnectionArguments;
use crate::output::print_text;
use crate::progress::Progress;
use crate::topics::TopicArguments;
use crate::{Boxed, CommandError};

/// Arguments of `fleetcal replay`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The recording: ROS 2 messages in MCAP or in a .db3 of rosbag2, or its folder
    pub recording: PathBuf,
    /// Connection to the service.
    #[command(flatten)]
    pub connection: ConnectionArguments,
    /// Id of the replayed robot [default: the first chunk of the wheel odometry topic]
    #[arg(long, value_name = "ID", value_parser = RobotId::parse)]
    pub robot: Option<RobotId>,
    /// Speed relative to the recording, or `max`: as fast as the service processes
    #[arg(long, value_name = "N|max", default_value = "1", value_parser = str::parse::<Rate>)]
    pub rate: Rate,
    /// Topics to send.
    #[command(flatten)]
    pub topics: TopicArguments,
    /// First chunk of every key
    #[arg(long, value_name = "CHUNK", default_value = "fleet", value_parser = KeyRoot::parse)]
    pub root: KeyRoot,
}

/// Runs the command.
///
/// # Errors
/// One sentence, with its exit status.
pub fn run(arguments: &Arguments) -> Boxed<'_> {
    Box::pin(perform(arguments))
}

async fn perform(arguments: &Arguments) -> Result<(), CommandError> {
    let mut options = ReplayOptions::new(
        arguments.recording.clone(),
        arguments.connection.connection(),
    );
    options.robot.clone_from(&arguments.robot);
    options.rate = arguments.rate;
    options.topics = arguments.topics.asked();
    options.keys = Keys::new(arguments.root.clone());
    let mut bar = None;
    let summary = replay(options, |progress| {
        bar.get_or_insert_with(|| Progress::over(progress.total))
            .advance();
    })
    .await?;
    if let Some(bar) = bar {
        bar.finish();
    }
    print_text(&in_words(&summary))
}

fn in_words(summary: &ReplaySummary) -> String {
    let ReplaySummary {
        robot,
        drive_samples,
        scans,
        dropped,
        unconfirmed,
        duration,
    } = summary;
    format!(
        "{robot}: {drive_samples} drive samples and {scans} scans sent in {:.1} s; {dropped} dropped or \
         refused by the service, {unconfirmed} lost while it restarted\n",
        duration.as_secs_f64()
    )
}
