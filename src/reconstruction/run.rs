//! The whole method in one screen: cloud and settings in, mesh and report out.

use super::blocks::{self, Refined, State};
use super::cloud::PointCloud;
use super::error::Error;
use super::mesh::TriangleMesh;
use super::mesher::Mesher;
use super::model::Model;
use super::network::{Engine, Ensemble, Scalar, engine};
use super::observer::{Event, Observer, Phase};
use super::report::{Report, Stopwatch, Subject, TrainingReport};
use super::sampling::{Prepared, Scan, boundary, scan};
use super::settings::{OutputLayer, Precision, Settings, Training};
use super::surface::Field;
use super::training::{Hooks, Identity, Problem, Termination, Trained, train};

/// What a run gives.
#[derive(Debug, Clone)]
pub struct Reconstruction {
    /// The surface, in the coordinates of the input.
    pub mesh: TriangleMesh,
    /// Its quality, and the record that makes the run again.
    pub report: Report,
    /// The trained network.
    pub model: Model,
}

/// Sets the number of threads of every later run in this process.
///
/// rayon's pool belongs to the process, and so does this choice. libtorch always gets one thread: on
/// matrices as narrow as these networks a second one gained nothing (measured at 3500 × 50), and its
/// idle threads spin, which costs twenty times where another process wants the core.
///
/// # Errors
/// When the threads were set to another number before.
pub fn set_threads(threads: usize) -> Result<(), Error> {
    tch::set_num_threads(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    match pool.build_global() {
        Err(_) if rayon::current_num_threads() != threads => Err(Error::Threads {
            asked: threads,
            set: rayon::current_num_threads(),
        }),
        _ => Ok(()),
    }
}

/// Runs `work` on one of the threads of [`set_threads`].
///
/// From there, to share work costs next to nothing; a thread that is none of them has to wake them and to be
/// woken for each piece, and an evaluation of few samples is over in less time.
pub fn in_pool<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    rayon::scope(|_| work())
}

/// Reconstructs the closed surface that `cloud` was taken from.
///
/// # Errors
/// What is wrong with the cloud or the settings, see [`Error`]. Training that does not converge is
/// no error: the report says why it ended.
///
/// # Determinism
/// The same cloud, settings and number of threads ([`set_threads`]) give the same mesh, bit for
/// bit, unless a time limit ends the training.
pub fn reconstruct(
    cloud: &PointCloud,
    settings: &Settings,
    observer: &dyn Observer,
) -> Result<Reconstruction, Error> {
    let result = match settings.network.precision {
        Precision::F32 => run::<f32>(cloud, settings, observer),
        Precision::F64 => run::<f64>(cloud, settings, observer),
    };
    match result {
        // The stages know one way to stop; the observer knows why.
        Err(Error::Cancelled) if !observer.cancelled() => Err(Error::Interrupted),
        result => result,
    }
}

fn run<T: Scalar>(
    cloud: &PointCloud,
    settings: &Settings,
    observer: &dyn Observer,
) -> Result<Reconstruction, Error> {
    let stopped = || observer.cancelled() || observer.released();
    let mut stopwatch = Stopwatch::new(observer);

    observer.event(Event::Phase(Phase::Sampling));
    cloud.validate()?;
    let boundary = boundary(cloud, settings)?;
    let cloud = boundary.as_ref().map_or(cloud, |body| &body.cloud);
    let least_noise = boundary.as_ref().map_or(0.0, |body| body.noise);
    let (mut prepared, scan) = scan(cloud, settings, least_noise, &stopped)?;
    let done = boundary.as_ref().map(|body| body.warning.clone());
    prepared.warnings.splice(0..0, done);
    for warning in &prepared.warnings {
        observer.event(Event::Warning(warning));
    }
    stopwatch.lap(Phase::Sampling);

    observer.event(Event::Phase(Phase::Training));
    let ensemble = Ensemble::new(&settings.network, prepared.uncertain);
    let engine = engine::<T>(
        settings.training.engine,
        &ensemble.architecture,
        &prepared.training,
    )?;
    let identity = Identity::new(settings, &prepared.training, &prepared.validation);
    let resumed = observer
        .checkpoint()
        .and_then(|bytes| State::<T>::decode(bytes, &identity));
    let (state, refines) = if let Some(state) = resumed {
        (state, true)
    } else {
        let parameters = ensemble.initial_parameters::<T>(settings.training.seed);
        let problem = problem(engine.as_ref(), settings, &prepared);
        let mesher = Mesher::new(cloud, settings, &prepared, observer);
        let (trained, refines) = fit(problem, parameters, &mesher, scan.as_ref())?;
        (State::start(trained), refines)
    };
    let refined = match &scan {
        Some(scan) if refines => Some(blocks::refine(
            settings,
            &mut prepared,
            scan,
            &state,
            observer,
        )?),
        _ => None,
    };
    let trained = state.coarse;
    let field = problem(engine.as_ref(), settings, &prepared).field(&trained.parameters)?;
    let field: Box<dyn Field> = match &refined {
        Some(refined) => Box::new(refined.field(Box::new(field))?),
        None => Box::new(field),
    };
    let mesher = Mesher::new(cloud, settings, &prepared, observer);
    stopwatch.lap(Phase::Training);

    observer.event(Event::Phase(Phase::Surface));
    let progress = |share| observer.event(Event::Progress(share));
    let (mesh, surface) = mesher.mesh(field.as_ref(), &stopped, &progress)?;
    for warning in surface.warnings() {
        observer.event(Event::Warning(&warning));
    }
    stopwatch.lap(Phase::Surface);

    observer.event(Event::Phase(Phase::Report));
    let subject = Subject {
        cloud,
        settings,
        prepared: &prepared,
        mesh: &mesh,
        ensemble: &ensemble,
        blocks: refined.as_ref().map(Refined::report),
        field: field.as_ref(),
        engine: engine.name(),
    };
    let mut report = Report::new(&subject, TrainingReport::new(&trained), surface)?;
    stopwatch.lap(Phase::Report);
    report.seconds = stopwatch.seconds();
    let model = Model {
        settings: settings.clone(),
        ensemble,
        frame: prepared.frame,
        parameters: trained.parameters.iter().map(|p| p.to_f64()).collect(),
        blocks: refined.as_ref().map(Refined::model),
    };
    Ok(Reconstruction {
        mesh,
        report,
        model,
    })
}

fn problem<'a, T>(
    engine: &'a dyn Engine<T>,
    settings: &Settings,
    prepared: &'a Prepared,
) -> Problem<'a, T> {
    Problem {
        engine,
        validation: &prepared.validation,
        weight_decay: prepared.weight_decay,
        output_layer: output_layer(settings, prepared),
    }
}

/// Trains one network, or an ensemble; a snapshot is extracted at each chosen evaluation. Whether blocks are to go on
/// from there comes with it.
fn fit<T: Scalar>(
    problem: Problem<'_, T>,
    parameters: Vec<T>,
    mesher: &Mesher<'_>,
    scan: Option<&Scan>,
) -> Result<(Trained<T>, bool), Error> {
    let leaves_too_much = |parameters: &[T]| match scan {
        None => Ok(false),
        Some(scan) => {
            let field = problem.field(parameters)?;
            blocks::needed(&field, mesher.settings, mesher.prepared, scan)
        }
    };
    // Of uncertain points, an ensemble that has not settled yet leaves more than it will.
    let has_more = !mesher.prepared.uncertain
        || scan.is_some_and(|s| s.indices.len() > mesher.settings.sampling.surface_points);
    let mut snapshot = |evaluation: u64, parameters: &[T]| {
        let field = problem.field(parameters)?;
        // Training takes care of a release after this iteration, without losing it.
        // Its progress is not that of training.
        match mesher.mesh(&field, &|| mesher.observer.cancelled(), &|_| {}) {
            Ok((mesh, _)) => {
                mesher.observer.event(Event::Snapshot {
                    evaluation,
                    mesh: &mesh,
                });
                Ok(())
            }
            // Early in training there may be no surface yet; that is worth no failed run.
            Err(Error::NoSurface(_)) => Ok(()),
            Err(error) => Err(error),
        }
    };
    let hooks = Hooks {
        observer: mesher.observer,
        snapshot: &mut snapshot,
        enough: &mut |evaluations, parameters| {
            let looks = has_more
                && evaluations.start < blocks::FIRST_LOOK
                && evaluations.end >= blocks::FIRST_LOOK;
            Ok(looks && leaves_too_much(parameters)?)
        },
        identity: Identity::new(
            mesher.settings,
            &mesher.prepared.training,
            &mesher.prepared.validation,
        ),
    };
    let training = Training {
        history: mesher.settings.kept_pairs(mesher.prepared.training.len()),
        ..mesher.settings.training.clone()
    };
    let trained = train(problem, parameters, &training, hooks)?;
    if trained.termination == Termination::Cancelled {
        return Err(Error::Cancelled);
    }
    let refines = match trained.termination {
        Termination::HandedOver => true,
        Termination::TimeLimit => false,
        _ => leaves_too_much(&trained.parameters)?,
    };
    Ok((trained, refines))
}

/// The output layer is solved for where that is a linear problem: bounds make it none.
fn output_layer(settings: &Settings, prepared: &Prepared) -> OutputLayer {
    if prepared.training.one_sided.contains(&true) {
        OutputLayer::Trained
    } else {
        settings.training.output_layer
    }
}
