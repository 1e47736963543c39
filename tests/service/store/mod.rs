//! The store by itself.

mod attempts;
mod audit;
mod catalogue;
mod content;
mod life;
mod machine;
pub(crate) mod migrations;
mod moving;
mod objects;
pub(crate) mod support;
pub(crate) mod tenants;
mod turns;
mod writer;
