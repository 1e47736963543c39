//! The golden traces of PyTorch.

use std::fs;
use std::path::Path;

use meshway::reconstruction::verify::{Error, Trace, TraceResult, verify};

fn folder() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/numerics/reference")
}

fn check(name: &str) -> TraceResult {
    // Tests run side by side, and libtorch's threads spin.
    tch::set_num_threads(1);
    let description = fs::read(folder().join(format!("{name}.json"))).unwrap();
    let tensors = fs::read(folder().join(format!("{name}.safetensors"))).unwrap();
    verify(&Trace {
        name,
        description: &description,
        tensors: &tensors,
    })
    .unwrap()
}

#[test]
fn every_trace_is_repeated() {
    for name in [
        "sphere_plain",
        "sphere_resnet",
        "sphere_highway",
        "sphere_gated",
        "sphere_hw",
        "sphere_sqrhw",
        "sphere_sqrhw_lr1",
        "sphere_sqrhw_exterior",
    ] {
        let result = check(name);
        assert!(result.passed, "{result:?}");
        let fused = !["sphere_highway", "sphere_gated"].contains(&name);
        assert_eq!(result.fused_difference.is_some(), fused, "{result:?}");
        // A sum of 220 terms in another order: a few units in the last place of f64.
        assert!(result.gradient_difference < 1e-12, "{result:?}");
        // The last losses agree to 1e-7; f is about its square root, without squaring.
        assert!(result.prediction_difference < 1e-5, "{result:?}");
    }
}

#[test]
fn another_run_does_not_pass() {
    let name = "sphere_sqrhw";
    let description = fs::read_to_string(folder().join(format!("{name}.json"))).unwrap();
    let tensors = fs::read(folder().join(format!("{name}.safetensors"))).unwrap();
    let other = description.replace("\"learning_rate\": 0.1,", "\"learning_rate\": 0.10001,");
    assert_ne!(other, description);
    let result = verify(&Trace {
        name,
        description: other.as_bytes(),
        tensors: &tensors,
    })
    .unwrap();
    assert!(!result.passed, "{result:?}");
}

#[test]
fn damaged_files_are_errors() {
    let description = fs::read(folder().join("sphere_hw.json")).unwrap();
    let tensors = fs::read(folder().join("sphere_hw.safetensors")).unwrap();
    let check = |description: &[u8], tensors: &[u8]| {
        let name = "damaged";
        verify(&Trace {
            name,
            description,
            tensors,
        })
        .unwrap_err()
    };
    let cut = &tensors[..tensors.len() - 8];
    assert!(matches!(check(b"{}", &tensors), Error::Description(_)));
    assert!(matches!(check(&description, cut), Error::Tensors(_)));

    let change = |from: &str, to: &str| {
        let text = String::from_utf8(description.clone()).unwrap();
        assert!(text.contains(from));
        text.replace(from, to).into_bytes()
    };
    let wider = change("\"width\": 50", "\"width\": 51");
    assert!(matches!(check(&wider, &tensors), Error::Shape { .. }));
    let huge = change(
        "\"hidden_layers\": 5",
        "\"hidden_layers\": 18446744073709551615",
    );
    assert!(matches!(check(&huge, &tensors), Error::Network { .. }));
    let more = change("\"n_surface\": 200", "\"n_surface\": 18446744073709551615");
    assert!(matches!(check(&more, &tensors), Error::Shape { .. }));
}
