//! The `meshway` program.

fn main() {}
