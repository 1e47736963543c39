//! What a user sees of a run: a bar on a terminal, plain lines otherwise; and the metrics kept.

use std::cell::{Cell, RefCell};
use std::io::{IsTerminal, Write};
use std::time::Instant;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::training::{GradientHistogram, Metrics};
use crate::reconstruction::{Event, Observer, Phase};

/// Seconds between two plain lines of one phase.
const LINE_INTERVAL_SECONDS: f64 = 5.0;
/// Steps of the bar in one phase.
const STEPS: u64 = 1_000;

/// The observer of the command line.
pub(super) struct Progress {
    start: Instant,
    bar: Option<ProgressBar>,
    quiet: bool,
    phase: Cell<Phase>,
    phase_start: Cell<f64>,
    last_line: Cell<f64>,
    fraction: Cell<f64>,
    metrics: RefCell<Vec<Metrics>>,
    gradients: RefCell<Vec<GradientHistogram>>,
    snapshots: RefCell<Vec<(u64, TriangleMesh)>>,
}

impl Progress {
    pub(super) fn new(quiet: bool) -> Self {
        let terminal = !quiet && std::io::stderr().is_terminal();
        let bar = terminal.then(|| bar(ProgressDrawTarget::stderr()));
        Self {
            start: Instant::now(),
            bar,
            quiet,
            phase: Cell::new(Phase::Sampling),
            phase_start: Cell::new(0.0),
            last_line: Cell::new(f64::NEG_INFINITY),
            fraction: Cell::new(0.0),
            metrics: RefCell::default(),
            gradients: RefCell::default(),
            snapshots: RefCell::default(),
        }
    }

    pub(super) fn metrics(&self) -> std::cell::Ref<'_, Vec<Metrics>> {
        self.metrics.borrow()
    }

    pub(super) fn gradients(&self) -> std::cell::Ref<'_, Vec<GradientHistogram>> {
        self.gradients.borrow()
    }

    pub(super) fn snapshots(&self) -> std::cell::Ref<'_, Vec<(u64, TriangleMesh)>> {
        self.snapshots.borrow()
    }

    /// Removes the bar, so that what is printed next stands alone.
    pub(super) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    /// One line to the user; above the bar where there is one.
    pub(super) fn say(&self, line: &str) {
        if self.quiet {
            return;
        }
        match &self.bar {
            Some(bar) => bar.println(line),
            // A closed standard error must not end the run.
            None => drop(writeln!(std::io::stderr(), "{line}")),
        }
    }

    fn enter(&self, phase: Phase) {
        self.phase.set(phase);
        self.phase_start.set(self.seconds());
        self.fraction.set(0.0);
        self.last_line.set(self.seconds());
        match &self.bar {
            Some(bar) => {
                bar.set_position(0);
                bar.set_prefix(name(phase));
                bar.set_message("");
            }
            None => self.say(name(phase)),
        }
    }

    fn advance(&self, fraction: f64) {
        self.fraction.set(fraction);
        let message = match self.metrics.borrow().last() {
            Some(m) if self.phase.get() == Phase::Training => {
                format!("loss {:.3e} at evaluation {}", m.loss, m.evaluation)
            }
            _ => String::new(),
        };
        let elapsed = self.seconds() - self.phase_start.get();
        let remaining = if fraction > 0.01 && elapsed > 0.5 {
            format!(
                ", about {:.0} s left",
                elapsed * (1.0 - fraction) / fraction
            )
        } else {
            String::new()
        };
        if let Some(bar) = &self.bar {
            bar.set_position((fraction * STEPS as f64) as u64);
            bar.set_message(format!("{message}{remaining}"));
        } else if self.seconds() - self.last_line.get() >= LINE_INTERVAL_SECONDS {
            self.last_line.set(self.seconds());
            let phase = name(self.phase.get());
            self.say(&format!(
                "{phase} {:.0} % {message}{remaining}",
                100.0 * fraction
            ));
        }
    }
}

/// A bar in one line, however narrow the terminal: the message is cut, not wrapped.
fn bar(target: ProgressDrawTarget) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(STEPS), target);
    if let Ok(style) = ProgressStyle::with_template("{prefix:>9} {bar:16} {wide_msg}") {
        bar.set_style(style);
    }
    bar
}

fn name(phase: Phase) -> &'static str {
    match phase {
        Phase::Sampling => "sampling",
        Phase::Training => "training",
        Phase::Surface => "surface",
        Phase::Report => "report",
    }
}

impl Observer for Progress {
    fn event(&self, event: Event<'_>) {
        match event {
            Event::Phase(phase) => self.enter(phase),
            Event::Progress(fraction) => self.advance(fraction),
            Event::Metrics(metrics) => self.metrics.borrow_mut().push(metrics.clone()),
            Event::Gradients(histogram) => self.gradients.borrow_mut().push(histogram.clone()),
            Event::Snapshot {
                evaluation, mesh, ..
            } => {
                self.snapshots.borrow_mut().push((evaluation, mesh.clone()));
            }
            Event::Warning(warning) => self.say(&format!("warning: {}", warning.message)),
            // A run of the command line is not taken up again.
            Event::Checkpoint { .. } => {}
        }
    }

    fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}

#[cfg(test)]
mod tests {
    use std::io;
    use std::sync::{Arc, Mutex};

    use indicatif::TermLike;

    use super::*;

    /// A terminal of so many columns, and what was written to it.
    #[derive(Debug, Clone)]
    struct Terminal {
        columns: u16,
        written: Arc<Mutex<Vec<String>>>,
    }

    impl TermLike for Terminal {
        fn width(&self) -> u16 {
            self.columns
        }

        fn move_cursor_up(&self, _: usize) -> io::Result<()> {
            Ok(())
        }

        fn move_cursor_down(&self, _: usize) -> io::Result<()> {
            Ok(())
        }

        fn move_cursor_right(&self, _: usize) -> io::Result<()> {
            Ok(())
        }

        fn move_cursor_left(&self, _: usize) -> io::Result<()> {
            Ok(())
        }

        fn write_line(&self, text: &str) -> io::Result<()> {
            self.write_str(text)
        }

        fn write_str(&self, text: &str) -> io::Result<()> {
            self.written.lock().unwrap().push(text.to_owned());
            Ok(())
        }

        fn clear_line(&self) -> io::Result<()> {
            Ok(())
        }

        fn flush(&self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn the_bar_is_one_line_on_a_narrow_terminal() {
        for columns in [50, 100] {
            let terminal = Terminal {
                columns,
                written: Arc::default(),
            };
            let bar = bar(ProgressDrawTarget::term_like(Box::new(terminal.clone())));
            bar.set_prefix(name(Phase::Training));
            bar.set_message("loss 1.234e-5 at evaluation 1200, about 3600 s left");
            bar.set_position(STEPS / 2);
            bar.tick();
            let written = terminal.written.lock().unwrap();
            let lines: Vec<&str> = written.iter().map(|line| line.trim_end()).collect();
            let drawn = lines.iter().rfind(|line| line.contains("training"));
            let drawn = drawn.expect("the bar is drawn");
            assert!(drawn.contains('█'), "{columns}: {drawn}");
            assert!(drawn.contains("loss 1.234e-5"), "{columns}: {drawn}");
            for line in &lines {
                assert!(line.chars().count() <= usize::from(columns), "{line}");
            }
        }
    }
}
