//! Where the worker of a job and idle ones meet: what the computation offers goes to the store, and what was fitted
//! comes back. What fails here is logged: the computation fits it itself.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::MissedTickBehavior;

use crate::jobs::{Claim, Result, Store};
use crate::reconstruction::{Helpers, processor};

/// Time between two looks at what became of offers.
const LOOK: Duration = Duration::from_millis(500);
/// Shares that wait for a helper at most, some 5 MB each.
const MOST: usize = 32;

/// What the computation wants done.
pub(super) enum Order {
    Offer(usize, Vec<u8>),
    Withdraw(usize),
}

/// The side of the computation.
pub(super) struct Desk {
    orders: mpsc::UnboundedSender<Order>,
    /// Whether the computation has come to its blocks.
    asked: AtomicBool,
    wanted: AtomicUsize,
    /// What came back, and was not taken yet.
    back: Mutex<VecDeque<(usize, Vec<u8>)>>,
}

impl Desk {
    /// A desk, and what is to be done there by [`Clerk::serve`].
    pub(super) fn new() -> (Arc<Self>, mpsc::UnboundedReceiver<Order>) {
        // As many as are wanted, which is told only once those before are there.
        let (orders, receiver) = mpsc::unbounded_channel();
        let desk = Self {
            orders,
            asked: AtomicBool::new(false),
            wanted: AtomicUsize::new(0),
            back: Mutex::default(),
        };
        (Arc::new(desk), receiver)
    }

    fn back(&self) -> MutexGuard<'_, VecDeque<(usize, Vec<u8>)>> {
        self.back.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Helpers for Desk {
    fn wanted(&self) -> usize {
        self.asked.store(true, Ordering::Relaxed);
        self.wanted.swap(0, Ordering::Relaxed)
    }

    fn offer(&self, share: usize, input: Vec<u8>) {
        // Nobody listens any more once the attempt was given up.
        drop(self.orders.send(Order::Offer(share, input)));
    }

    fn withdraw(&self, share: usize) {
        drop(self.orders.send(Order::Withdraw(share)));
    }

    fn fitted(&self) -> Option<(usize, Vec<u8>)> {
        self.back().pop_front()
    }
}

/// The side of the store.
pub(super) struct Clerk {
    pub(super) store: Store,
    pub(super) claim: Claim,
    pub(super) desk: Arc<Desk>,
    /// Worker processes of this service.
    pub(super) slots: u16,
}

impl Clerk {
    /// Does what is ordered, until the task is dropped.
    pub(super) async fn serve(self, mut orders: mpsc::UnboundedReceiver<Order>) {
        let mut looks = tokio::time::interval(LOOK);
        looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            let done = tokio::select! {
                // In this order: what is wanted depends on what was offered.
                biased;
                Some(order) = orders.recv() => self.follow(order).await,
                _ = looks.tick() => self.look().await,
            };
            if let Err(error) = done {
                let job = self.claim.job_id();
                tracing::warn!(%job, error.message = %error, "idle workers do not help");
            }
        }
    }

    async fn follow(&self, order: Order) -> Result<()> {
        match order {
            Order::Offer(share, input) => {
                let offer = (processor(), input.into());
                self.store.offer_share(&self.claim, share, offer).await
            }
            Order::Withdraw(share) => self.store.close_share(&self.claim, share).await,
        }
    }

    /// Fetches what was fitted, and tells how many more shares are wanted: one for each idle worker.
    async fn look(&self) -> Result<()> {
        if !self.desk.asked.swap(false, Ordering::Relaxed) {
            return Ok(());
        }
        let mut waiting = 0;
        for offered in self.store.offered_shares(&self.claim).await? {
            if offered.is_fitted() {
                if let Some(networks) = self.store.networks(&offered).await? {
                    self.desk.back().push_back((offered.number, networks));
                }
                self.store.close_share(&self.claim, offered.number).await?;
            } else if !offered.is_begun {
                waiting += 1;
            }
        }
        let spare = self.store.spare_workers(self.slots).await?;
        let wanted = MOST.min(spare as usize).saturating_sub(waiting);
        self.desk.wanted.store(wanted, Ordering::Relaxed);
        Ok(())
    }
}
