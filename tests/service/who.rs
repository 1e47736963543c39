//! In whose name tests ask a store.

use std::sync::LazyLock;

use meshway::identity::{Caller, Tenant};

/// The tenant of services without keys.
pub(crate) fn ours() -> &'static Tenant {
    static OURS: LazyLock<Tenant> = LazyLock::new(Tenant::default);
    &OURS
}

/// Whoever asks them.
pub(crate) fn us() -> &'static Caller {
    static US: LazyLock<Caller> = LazyLock::new(Caller::anybody);
    &US
}
