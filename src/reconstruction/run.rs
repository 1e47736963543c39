//! The whole method in one screen: cloud and settings in, mesh and report out.

use super::blocks::{self, Ground, Refined, State};
use super::cloud::PointCloud;
use super::coarse;
use super::error::Error;
use super::mesh::TriangleMesh;
use super::mesher::Mesher;
use super::model::Model;
use super::network::{MeanField, Scalar, engine};
use super::observer::{Event, Observer, Phase};
use super::plan::{Findings, Plan};
use super::report::{Report, Stopwatch, Subject, TrainingReport};
use super::sampling::{boundary, scan};
use super::settings::{Precision, Settings};
use super::surface::Field;

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

/// Reconstructs the closed surface that `cloud` was taken from.
///
/// # Errors
/// What is wrong with the cloud or the settings, see [`Error`]. Training that does not converge is
/// no error: the report says why it ended.
///
/// # Determinism
/// The same cloud, settings and number of threads ([`set_threads`](super::threads::set_threads)) give the same mesh, bit for
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
    let plan = Plan::new(settings, Findings::from(&prepared));
    let engine = engine::<T>(plan.engine, &plan.ensemble.architecture, &prepared.training)?;
    let identity = plan.identity(&prepared);
    let resumed = observer
        .checkpoint()
        .and_then(|bytes| State::<T>::decode(bytes, &identity));
    let (state, refines) = if let Some(state) = resumed {
        (state, true)
    } else {
        let mesher = Mesher::new(cloud, &plan, &prepared, observer);
        let (trained, refines) = coarse::fit(engine.as_ref(), &mesher, scan.as_ref(), identity)?;
        (State::start(trained, identity), refines)
    };
    let field = MeanField::of(engine.as_ref(), &state.coarse.parameters)?;
    let mut refined = match &scan {
        Some(scan) if refines => {
            let ground = Ground {
                cloud,
                plan: &plan,
                scan,
                observer,
            };
            blocks::refine(&ground, &mut prepared, (&state, &field))?
        }
        _ => None,
    };
    // The surface needs the memory.
    drop(scan);
    let trained = state.coarse;
    let begun = refined.as_mut().and_then(Refined::begun);
    let field: Box<dyn Field> = match &refined {
        Some(refined) => Box::new(refined.field(Box::new(field))?),
        None => Box::new(field),
    };
    let mesher = Mesher::new(cloud, &plan, &prepared, observer);
    stopwatch.lap(Phase::Training);

    observer.event(Event::Phase(Phase::Surface));
    let progress = |share| observer.event(Event::Progress(share));
    let (mesh, surface) = mesher.mesh((field.as_ref(), begun), &stopped, &progress)?;
    // So does the report.
    drop(mesher);
    for warning in surface.warnings() {
        observer.event(Event::Warning(&warning));
    }
    stopwatch.lap(Phase::Surface);

    observer.event(Event::Phase(Phase::Report));
    let subject = Subject {
        cloud,
        plan: &plan,
        prepared: &prepared,
        mesh: &mesh,
        blocks: refined
            .as_ref()
            .map(|refined| refined.report(&prepared.frame)),
        field: field.as_ref(),
        engine: engine.name(),
    };
    let mut report = Report::new(&subject, TrainingReport::new(&trained), surface)?;
    stopwatch.lap(Phase::Report);
    report.seconds = stopwatch.seconds();
    let model = Model {
        settings: settings.clone(),
        ensemble: plan.ensemble,
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
