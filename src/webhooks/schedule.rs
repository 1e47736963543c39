//! When a message is tried again.

use super::post::Answer;
use crate::jobs::{Next, Tried};

const SECOND_MS: i64 = 1_000;
const MINUTE_MS: i64 = 60 * SECOND_MS;
const HOUR_MS: i64 = 60 * MINUTE_MS;

/// Time after each failed try until the next one; after the last of them there is none. As the standard
/// proposes, over three days.
const DELAYS_MS: [i64; 9] = [
    5 * SECOND_MS,
    5 * MINUTE_MS,
    30 * MINUTE_MS,
    2 * HOUR_MS,
    5 * HOUR_MS,
    10 * HOUR_MS,
    14 * HOUR_MS,
    20 * HOUR_MS,
    24 * HOUR_MS,
];

/// Longest time that a receiver which is not there keeps other messages waiting.
const LONGEST_PAUSE_MS: i64 = 5 * MINUTE_MS;

/// Longest time that a receiver can ask for.
const LONGEST_WISH_MS: i64 = 24 * HOUR_MS;

/// What comes after a try: the `before`-th failed before it. `share`, 0 to 1, spreads tries that would
/// come together.
pub(super) fn after(answer: Result<Answer, String>, before: u32, now: i64, share: f64) -> Tried {
    let (status, error, wish) = match answer {
        Ok(answer) if (200..300).contains(&answer.status) => {
            return Tried {
                status: Some(answer.status),
                error: None,
                next: Next::Nothing,
            };
        }
        Ok(answer) => {
            let error = match answer.status {
                300..400 => "a redirect, which is not followed",
                410 => {
                    "the receiver is gone for good; no message is sent until the webhook is enabled"
                }
                _ => "the receiver did not take it",
            };
            (Some(answer.status), error.to_owned(), answer.retry_after)
        }
        Err(error) => (None, error, None),
    };
    let delay = usize::try_from(before)
        .ok()
        .and_then(|before| DELAYS_MS.get(before));
    let next = match (status, delay) {
        (Some(410), _) => Next::Gone,
        (_, None) => Next::Nothing,
        (_, Some(&delay)) => {
            let wish = i64::from(wish.unwrap_or(0)) * SECOND_MS;
            let delay = delay + (0.1 * share * delay as f64) as i64;
            let delay = delay.max(wish.min(LONGEST_WISH_MS));
            // One that is not there, or has too much to do, would not take other messages either.
            let absent = matches!(status, None | Some(429 | 502 | 503 | 504));
            let pause = if absent {
                delay.min(LONGEST_PAUSE_MS)
            } else {
                0
            };
            Next::Again {
                due_at: now + delay,
                wait_until: now + pause,
            }
        }
    };
    Tried {
        status,
        error: Some(error),
        next,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answered(status: u16, retry_after: Option<u32>) -> Answer {
        Answer {
            status,
            retry_after,
        }
    }

    #[test]
    fn tries_follow_the_schedule_and_end() {
        let dead = || Err("connection refused".to_owned());
        let (mut now, mut tries) = (0, 0);
        while let Next::Again { due_at, wait_until } = after(dead(), tries, now, 0.5).next {
            assert!(wait_until > now && wait_until <= due_at.min(now + LONGEST_PAUSE_MS));
            now = due_at;
            tries += 1;
        }
        assert_eq!(tries, 9);
        let days = now as f64 / (24 * HOUR_MS) as f64;
        assert!((3.1..3.5).contains(&days), "{days}");
    }

    #[test]
    fn what_the_receiver_says_decides() {
        assert_eq!(
            after(Ok(answered(204, None)), 3, 0, 0.0).next,
            Next::Nothing
        );
        let gone = after(Ok(answered(410, None)), 0, 0, 0.0);
        assert_eq!((gone.status, gone.next), (Some(410), Next::Gone));
        let again = |status, wish| match after(Ok(answered(status, wish)), 0, 0, 0.0).next {
            Next::Again { due_at, wait_until } => (due_at, wait_until),
            other => panic!("{status}: {other:?}"),
        };
        // It refuses this message; others may be welcome.
        assert_eq!(again(400, None), (5_000, 0));
        assert_eq!(again(302, None), (5_000, 0));
        assert_eq!(again(503, None), (5_000, 5_000));
        assert_eq!(again(429, Some(120)), (120_000, 120_000));
        assert_eq!(again(503, Some(3_600)), (HOUR_MS, LONGEST_PAUSE_MS));
        assert_eq!(again(503, Some(u32::MAX)).0, LONGEST_WISH_MS);
    }
}
