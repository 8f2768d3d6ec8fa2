//! A progress bar, on a terminal only.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Messages between two looks at the bar: drawing must not cost what it shows.
const DRAWN_EVERY: u64 = 256;

/// How far a command is with a recording.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
    done: u64,
}

impl Progress {
    /// A bar over `messages`, shown on standard error when that is a terminal.
    pub fn over(messages: u64) -> Self {
        let target = if std::io::stderr().is_terminal() {
            ProgressDrawTarget::stderr()
        } else {
            ProgressDrawTarget::hidden()
        };
        let bar = ProgressBar::with_draw_target(Some(messages), target);
        if let Ok(style) = ProgressStyle::with_template("{bar:40} {percent:>3} %  {eta} left") {
            bar.set_style(style);
        }
        Self { bar, done: 0 }
    }

    /// One message further.
    pub fn advance(&mut self) {
        self.done += 1;
        if self.done.is_multiple_of(DRAWN_EVERY) {
            self.bar.set_position(self.done);
        }
    }

    /// Takes the bar away.
    pub fn finish(self) {
        self.bar.finish_and_clear();
    }
}
