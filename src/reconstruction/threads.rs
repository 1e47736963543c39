//! The threads that every run of the process shares.

use super::error::Error;

/// Sets the number of threads of every later run in this process.
///
/// rayon's pool belongs to the process, and so does this choice. libtorch always gets one thread: on
/// matrices as narrow as these networks a second one gained nothing (measured at 3500 × 50), and its
/// idle threads spin, which costs twenty times where another process wants the core.
///
/// # Errors
/// When the threads were set to another number before.
pub fn set_threads(threads: usize) -> Result<(), Error> {
    tch::set_num_threads(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    match pool.build_global() {
        Err(_) if rayon::current_num_threads() != threads => Err(Error::Threads {
            asked: threads,
            set: rayon::current_num_threads(),
        }),
        _ => Ok(()),
    }
}

/// Runs `work` on one of the threads of [`set_threads`].
///
/// Sharing work costs next to nothing there. Calling from outside the pool costs a wake-up for each piece, and an
/// evaluation of few samples is over in less time.
pub fn in_pool<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    rayon::scope(|_| work())
}
