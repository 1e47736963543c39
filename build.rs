//! Writes the libtorch folder into the run path, so that `cargo run`, `cargo test` and the built
//! binary find its libraries without environment variables.

use std::{env, fs, process};

fn main() {
    println!("cargo:rerun-if-env-changed=LIBTORCH");
    println!("cargo:rerun-if-changed=build.rs");
    let libtorch = env::var_os("LIBTORCH").map(fs::canonicalize);
    let Some(Ok(libtorch)) = libtorch else {
        println!("cargo:warning=libtorch is not set up: run `make setup`, or set LIBTORCH");
        process::exit(1);
    };
    // $ORIGIN/../lib first: an installed binary carries its libraries beside it.
    println!("cargo:rustc-link-arg=-Wl,-rpath,$ORIGIN/../lib");
    println!(
        "cargo:rustc-link-arg=-Wl,-rpath,{}",
        libtorch.join("lib").display()
    );
}
