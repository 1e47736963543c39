//! In whose name the store is asked.
//!
//! What belongs to a tenant is reached through [`Records`] and [`Acts`] alone, which are made of a
//! tenant and of a caller. So a handler that forgets whose record it wants does not compile. What is
//! left on [`Store`] is for the service itself: claims of workers, garbage, totals.

use super::Store;
use super::content::objects::Objects;
use super::sql::Readers;
use crate::identity::{Caller, Tenant};

/// The records of a tenant.
#[derive(Clone, Copy)]
pub struct Records<'s> {
    pub(in crate::jobs::store) store: &'s Store,
    pub(in crate::jobs::store) tenant: &'s Tenant,
}

impl<'s> Records<'s> {
    pub(in crate::jobs::store) fn new(store: &'s Store, tenant: &'s Tenant) -> Self {
        Self { store, tenant }
    }

    pub(in crate::jobs::store) fn readers(self) -> &'s Readers {
        self.store.readers()
    }

    pub(in crate::jobs::store) fn objects(self) -> &'s Objects {
        &self.store.inner.objects
    }
}

/// What a caller does to the records of its tenant.
#[derive(Clone, Copy)]
pub struct Acts<'s> {
    pub(in crate::jobs::store) store: &'s Store,
    pub(in crate::jobs::store) caller: &'s Caller,
}

impl<'s> Acts<'s> {
    pub(in crate::jobs::store) fn new(store: &'s Store, caller: &'s Caller) -> Self {
        Self { store, caller }
    }
}
