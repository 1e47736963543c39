use super::*;
use crate::reconstruction::network::Architecture;
use crate::reconstruction::sampling::Samples;
use crate::reconstruction::settings::{Engine, Preset, Training};

/// Two pieces of a bent sheet, with places on both sides of them.
fn share() -> Share {
    let settings = Preset::Fast.settings();
    let mut samples = Samples::default();
    let height = |x: f64, y: f64| 0.3 * (2.0 * x).sin() * y;
    let places = (0..120).map(|i| {
        let (column, row) = (f64::from(i % 12), f64::from(i / 12));
        (column / 6.0 - 1.0, row / 5.0 - 1.0)
    });
    for offset in [0.0, 0.2, -0.2] {
        let moved = places.clone().map(|(x, y)| [x, y, height(x, y) + offset]);
        samples.extend(moved.map(|place| (place, offset)));
    }
    let block = BlockInput {
        engine: Engine::Auto,
        architecture: Architecture::of_block(&settings.network),
        training: Training {
            max_evaluations: 30,
            history: 15,
            patience: 0,
            ..settings.training
        },
        seed: 7,
        round: 10,
        weight_decay: 1e-9,
        allowed: 1e-6,
        band: 0.5,
        samples,
        on_surface: 120,
        held_out: vec![[0.05, 0.05, height(0.05, 0.05)]],
        held_out_targets: vec![0.0],
    };
    let other = BlockInput {
        seed: 8,
        ..block.clone()
    };
    Share {
        blocks: vec![block, other],
    }
}

fn found(bytes: &[u8], input: &[u8]) -> Vec<Fitted<f32>> {
    networks(bytes, &Identity::of(input)).unwrap()
}

#[test]
fn blocks_that_came_as_bytes_have_the_same_networks() {
    let share = share();
    let go_on = Stop {
        stopped: &|| false,
        failed: AtomicBool::new(false),
    };
    let here: Vec<_> = share
        .blocks
        .iter()
        .map(|block| block.fit(&go_on).unwrap())
        .collect();
    assert!(
        here.iter().all(|block| block.loss < block.first_loss),
        "{here:?}"
    );
    assert_ne!(here[0].parameters, here[1].parameters);
    let bytes = share.encode();
    let there = fit_share(&bytes, &|| false).unwrap();
    assert_eq!(found(&there, &bytes), here);
}

#[test]
fn the_networks_of_another_share_are_refused() {
    let mut other = share();
    let fitted = fit_share(&other.encode(), &|| false).unwrap();
    other.blocks[1].seed += 1;
    let identity = Identity::of(&other.encode());
    assert!(networks::<f32>(&fitted, &identity).is_err());
}

#[test]
fn a_share_that_nobody_wants_ends() {
    let stopped = fit_share(&share().encode(), &|| true);
    assert!(matches!(stopped, Err(ShareError::Fit(Error::Cancelled))));
}

#[test]
fn damaged_input_is_refused() {
    let bytes = share().encode();
    for at in [0, 7, 40, 80, bytes.len() - 1] {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1;
        assert!(
            matches!(fit_share(&damaged, &|| false), Err(ShareError::Input(_))),
            "{at}"
        );
    }
    for length in [0, 8, 71, bytes.len() - 1] {
        assert!(Share::decode(&bytes[..length]).is_err(), "{length}");
    }
}

#[test]
fn input_that_contradicts_itself_is_refused() {
    let sound = share();
    assert_eq!(Share::decode(&sound.encode()).unwrap(), sound);
    let breaks: [fn(&mut BlockInput); 5] = [
        |input| input.round = 0,
        |input| input.on_surface = input.samples.len() + 1,
        |input| input.samples.targets.truncate(1),
        |input| input.held_out_targets.clear(),
        |input| input.architecture.width = 0,
    ];
    for (i, spoil) in breaks.iter().enumerate() {
        let mut share = share();
        spoil(&mut share.blocks[1]);
        assert!(Share::decode(&share.encode()).is_err(), "{i}");
    }
}
