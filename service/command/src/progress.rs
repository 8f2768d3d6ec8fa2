//! A progress bar, on a terminal only.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Messages between two updates of the bar: drawing must not cost more than it is worth.
const DRAWN_EVERY: u64 = 256;

/// Progress of a command through a recording.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
    done: u64,
}

impl Progress {
    /// Makes a bar over `messages`, shown on standard error if that is a terminal.
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

    /// Advances by one message.
    pub fn advance(&mut self) {
        self.done += 1;
        if self.done.is_multiple_of(DRAWN_EVERY) {
            self.bar.set_position(self.done);
        }
    }

    /// Removes the bar.
    pub fn finish(self) {
        self.bar.finish_and_clear();
    }
}
