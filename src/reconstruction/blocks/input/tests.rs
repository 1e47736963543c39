use super::*;
use crate::reconstruction::settings::Preset;

struct Quiet;

impl Observer for Quiet {
    fn event(&self, _: Event<'_>) {}

    fn seconds(&self) -> f64 {
        0.0
    }
}

/// A piece of a bent sheet, with places on both sides of it.
fn input(precision: Precision) -> BlockInput {
    let settings = Preset::Fast.settings();
    let mut samples = Samples::default();
    let height = |x: f64, y: f64| 0.3 * (2.0 * x).sin() * y;
    let places = (0..120).map(|i| (f64::from(i % 12) / 6.0 - 1.0, f64::from(i / 12) / 5.0 - 1.0));
    for offset in [0.0, 0.2, -0.2] {
        samples.extend(
            places
                .clone()
                .map(|(x, y)| ([x, y, height(x, y) + offset], offset)),
        );
    }
    BlockInput {
        precision,
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
    }
}

fn same_bits<T: Scalar>(precision: Precision) {
    let input = input(precision);
    let here: Fitted<T> = input.fit(&Quiet).unwrap();
    assert!(here.loss < here.first_loss, "{here:?}");
    let bytes = input.encode();
    let there = fit_block(&bytes, &Quiet).unwrap();
    assert_eq!(Fitted::decode(&there, &bytes).unwrap(), here);
}

#[test]
fn a_block_that_came_as_bytes_has_the_same_network() {
    same_bits::<f32>(Precision::F32);
    same_bits::<f64>(Precision::F64);
}

#[test]
fn the_network_of_another_input_is_refused() {
    let mut other = input(Precision::F32);
    let network = fit_block(&other.encode(), &Quiet).unwrap();
    other.seed += 1;
    assert!(Fitted::<f32>::decode(&network, &other.encode()).is_err());
}

#[test]
fn damaged_input_is_refused() {
    let bytes = input(Precision::F32).encode();
    for at in [0, 7, 40, 80, bytes.len() - 1] {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1;
        assert!(BlockInput::decode(&damaged).is_err(), "{at}");
    }
    for length in [0, 8, 71, bytes.len() - 1] {
        assert!(BlockInput::decode(&bytes[..length]).is_err(), "{length}");
    }
}

#[test]
fn input_that_contradicts_itself_is_refused() {
    let sound = input(Precision::F32);
    assert_eq!(BlockInput::decode(&sound.encode()).unwrap(), sound);
    let breaks: [fn(&mut BlockInput); 5] = [
        |input| input.round = 0,
        |input| input.on_surface = input.samples.len() + 1,
        |input| input.samples.targets.truncate(1),
        |input| input.held_out_targets.clear(),
        |input| input.architecture.width = 0,
    ];
    for (i, spoil) in breaks.iter().enumerate() {
        let mut input = sound.clone();
        spoil(&mut input);
        assert!(BlockInput::decode(&input.encode()).is_err(), "{i}");
    }
}
