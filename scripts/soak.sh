#!/usr/bin/env bash
# Submits jobs for some minutes while workers and servers are killed and stopped, then counts: no job
# lost, none ended twice. scripts/soak.sh [MINUTES]; the run prints its seed, and MESHWAY_SOAK_SEED
# repeats the choices of a run.
set -euo pipefail
cd "$(dirname "$0")/.."
minutes=${1:-10}
[[ $minutes =~ ^[0-9]+([.][0-9]+)?$ ]] || { echo "soak: $minutes is no number of minutes" >&2; exit 2; }
# Settling takes at most some minutes more than the faults; what hangs is a failure.
limit=$(awk "BEGIN { print int(60 * $minutes) + 600 }")
cargo test --locked --no-run --test service
MESHWAY_SOAK_MINUTES=$minutes timeout --kill-after=10 "$limit" \
  cargo test --locked --test service -- --ignored --exact --nocapture soak::no_job_is_lost_under_random_faults
