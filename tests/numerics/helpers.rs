//! Blocks that others fit: the result is that of the run alone, whatever becomes of what was offered.

use std::collections::BTreeSet;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use meshway::reconstruction::settings::Settings;
use meshway::reconstruction::{
    Error, Event, Helpers, Observer, Preset, Reconstruction, fit_share, reconstruct,
};

use crate::blocks::bumpy;

/// What helpers do with what they are offered.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    /// They fit it.
    Help,
    /// They send something else back.
    Spoil,
    /// They take it, and nothing comes back.
    Vanish,
    /// They fit it, and give each share the networks of the one before.
    Mix,
}

struct Others {
    way: Way,
    offered: Mutex<BTreeSet<usize>>,
    withdrawn: Mutex<BTreeSet<usize>>,
    done: Mutex<Vec<(usize, Vec<u8>)>>,
    before: Mutex<Vec<u8>>,
}

impl Others {
    fn new(way: Way) -> Self {
        Self {
            way,
            offered: Mutex::default(),
            withdrawn: Mutex::default(),
            done: Mutex::default(),
            before: Mutex::default(),
        }
    }
}

/// Fits a share as another process does, on threads of its own.
fn elsewhere(input: &[u8]) -> Vec<u8> {
    std::thread::scope(|scope| {
        let fitting = scope.spawn(|| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1);
            let fit = || fit_share(input, &|| false).unwrap();
            pool.build().unwrap().install(fit)
        });
        fitting.join().unwrap()
    })
}

impl Helpers for Others {
    fn wanted(&self) -> usize {
        1
    }

    fn offer(&self, share: usize, input: Vec<u8>) {
        assert!(self.offered.lock().unwrap().insert(share), "offered twice");
        let fitted = match self.way {
            Way::Help => elsewhere(&input),
            Way::Spoil => input,
            Way::Vanish => return,
            Way::Mix => {
                let fitted = elsewhere(&input);
                std::mem::replace(&mut *self.before.lock().unwrap(), fitted)
            }
        };
        self.done.lock().unwrap().push((share, fitted));
    }

    fn withdraw(&self, share: usize) {
        assert!(self.withdrawn.lock().unwrap().insert(share));
    }

    fn fitted(&self) -> Option<(usize, Vec<u8>)> {
        self.done.lock().unwrap().pop()
    }
}

struct Helped<'a>(Option<&'a Others>);

impl Observer for Helped<'_> {
    fn event(&self, _: Event<'_>) {}

    fn helpers(&self) -> Option<&dyn Helpers> {
        self.0.map(|others| others as &dyn Helpers)
    }

    fn seconds(&self) -> f64 {
        0.0
    }
}

/// Many tiny blocks, hardly fitted.
fn settings() -> Settings {
    let mut settings = Preset::Balanced.settings();
    settings.network.block_points = 4;
    settings.training.max_evaluations = 30;
    settings.training.block_evaluations = 3;
    settings.surface.resolution = 32;
    settings
}

fn run(settings: &Settings, threads: usize, others: Option<&Others>) -> Reconstruction {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    let run = || reconstruct(&bumpy(3_000), settings, &Helped(others)).unwrap();
    pool.build().unwrap().install(run)
}

#[test]
fn the_bits_do_not_depend_on_helpers() {
    let settings = settings();
    let alone = run(&settings, 2, None);
    let count = alone.report.blocks.as_ref().unwrap().count;
    let shares = count.div_ceil(64);
    assert!(shares > 3, "{count}");
    for (way, threads) in [Way::Help, Way::Spoil, Way::Vanish, Way::Mix]
        .into_iter()
        .flat_map(|way| [(way, 1), (way, 2)])
    {
        let others = Others::new(way);
        let helped = run(&settings, threads, Some(&others));
        assert_eq!(helped.mesh, alone.mesh);
        assert_eq!(helped.model, alone.model);
        let offered = others.offered.into_inner().unwrap();
        let withdrawn = others.withdrawn.into_inner().unwrap();
        assert!(offered.is_subset(&(1..shares).collect()), "{offered:?}");
        assert!(
            withdrawn.is_subset(&offered),
            "{withdrawn:?} of {offered:?}"
        );
        // The first thread waits while a helper here fits; only without a second one it is known who comes first.
        match way {
            Way::Vanish => assert_eq!(withdrawn, offered),
            Way::Help if threads == 1 => {
                assert!(offered.len() > 1, "{offered:?}");
                assert!(withdrawn.is_empty(), "{withdrawn:?}");
            }
            _ => assert!(threads > 1 || !offered.is_empty()),
        }
    }
}

#[test]
fn engines_whose_bits_depend_on_more_are_not_helped() {
    let mut settings = settings();
    settings.training.engine = meshway::reconstruction::settings::Engine::Libtorch;
    let others = Others::new(Way::Vanish);
    run(&settings, 2, Some(&others));
    assert!(others.offered.into_inner().unwrap().is_empty());
}

/// Asks for very many shares at once, and stops the run when it has the first.
#[derive(Default)]
struct Hurried {
    asked: AtomicBool,
    offered: AtomicUsize,
}

impl Helpers for Hurried {
    fn wanted(&self) -> usize {
        if self.asked.swap(true, Ordering::Relaxed) {
            0
        } else {
            1000
        }
    }

    fn offer(&self, _: usize, _: Vec<u8>) {
        self.offered.fetch_add(1, Ordering::Relaxed);
    }

    fn withdraw(&self, _: usize) {}

    fn fitted(&self) -> Option<(usize, Vec<u8>)> {
        None
    }
}

impl Observer for Hurried {
    fn event(&self, _: Event<'_>) {}

    fn helpers(&self) -> Option<&dyn Helpers> {
        Some(self)
    }

    fn cancelled(&self) -> bool {
        self.offered.load(Ordering::Relaxed) > 0
    }

    fn seconds(&self) -> f64 {
        0.0
    }
}

#[test]
fn a_run_is_stopped_between_two_shares() {
    let hurried = Hurried::default();
    let result = reconstruct(&bumpy(3_000), &settings(), &hurried);
    assert!(matches!(result, Err(Error::Cancelled)), "{result:?}");
    assert_eq!(hurried.offered.into_inner(), 1);
}
