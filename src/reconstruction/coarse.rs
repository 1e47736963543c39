//! The networks that fit a cloud as a whole: their training, and whether they leave too much of it.

use super::blocks;
use super::error::Error;
use super::mesher::Mesher;
use super::network::{Engine, MeanField, Scalar};
use super::observer::Event;
use super::sampling::Scan;
use super::training::{Hooks, Identity, Problem, Termination, Trained, train};

/// Trains one network, or an ensemble; a snapshot is extracted at each chosen evaluation. Whether blocks are to go on
/// from there comes with it.
///
/// # Errors
/// As for [`train`]; what the snapshots report.
pub(super) fn fit<T: Scalar>(
    engine: &dyn Engine<T>,
    mesher: &Mesher<'_>,
    scan: Option<&Scan>,
    identity: Identity,
) -> Result<(Trained<T>, bool), Error> {
    let (plan, prepared) = (mesher.plan, mesher.prepared);
    let leaves_too_much = |parameters: &[T], tolerated: f64| match (&plan.blocks, scan) {
        (Some(_), Some(scan)) => {
            let field = MeanField::of(engine, parameters)?;
            blocks::needed(&field, prepared, scan, tolerated)
        }
        _ => Ok(false),
    };
    let mut snapshot = |evaluation: u64, parameters: &[T]| {
        let field = MeanField::of(engine, parameters)?;
        // Training takes care of a release after this iteration, without losing it.
        // Its progress is not that of training.
        match mesher.mesh((&field, None), &|| mesher.observer.cancelled(), &|_| {}) {
            Ok((mesh, surface)) => {
                mesher.observer.event(Event::Snapshot {
                    evaluation,
                    mesh: &mesh,
                    verdict: mesher.verdict(&mesh, &surface),
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
            let blocks = plan.blocks.as_ref();
            let looks = blocks.map_or(&[][..], |blocks| &blocks.looks);
            let look = looks
                .iter()
                .find(|look| evaluations.contains(&(look.evaluations - 1)));
            look.map_or(Ok(false), |look| {
                leaves_too_much(parameters, look.tolerated)
            })
        },
        identity,
    };
    let problem = Problem {
        engine,
        validation: &prepared.validation,
        weight_decay: plan.weight_decay,
        output_layer: plan.output_layer,
    };
    let parameters = plan.ensemble.initial_parameters(plan.training.seed);
    let trained = train(problem, parameters, &plan.training, hooks)?;
    if trained.termination == Termination::Cancelled {
        return Err(Error::Cancelled);
    }
    let refines = match trained.termination {
        Termination::HandedOver => true,
        Termination::TimeLimit => false,
        _ => leaves_too_much(&trained.parameters, 1.0)?,
    };
    Ok((trained, refines))
}
