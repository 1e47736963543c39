//! The store by itself: the same tests over both databases, and those about one of them.

pub(crate) mod bare;
pub(crate) mod migrations;
mod moving;
#[path = "postgres/own.rs"]
mod on_postgres;
#[path = "sqlite/own.rs"]
mod on_sqlite;

/// The tests that hold for every database, over one of them.
macro_rules! suite {
    ($name:ident, $engine:expr) => {
        #[expect(clippy::duplicate_mod, reason = "once for each database")]
        pub(crate) mod $name {
            /// What the rows are in.
            pub(crate) const ENGINE: super::bare::Engine = $engine;

            #[path = "../attempts.rs"]
            mod attempts;
            #[path = "../audit.rs"]
            mod audit;
            #[path = "../catalogue.rs"]
            mod catalogue;
            #[path = "../content.rs"]
            mod content;
            #[path = "../history.rs"]
            mod history;
            #[path = "../life.rs"]
            mod life;
            #[path = "../machine.rs"]
            mod machine;
            #[path = "../objects.rs"]
            mod objects;
            #[path = "../shares.rs"]
            mod shares;
            #[path = "../submits.rs"]
            mod submits;
            #[path = "../support.rs"]
            pub(crate) mod support;
            #[path = "../tenants.rs"]
            mod tenants;
            #[path = "../turns.rs"]
            mod turns;
            #[path = "../writer.rs"]
            mod writer;
        }
    };
}

suite!(sqlite, super::bare::Engine::Sqlite);
suite!(postgres, super::bare::Engine::Postgres);

pub(crate) use sqlite::support;
