#!/usr/bin/env bash
# The dashboard in a browser: that its types are those of the contract, then whole ways through the
# pages of a served instance, in Debian's chromium without a window.
#
# MESHWAY: the program (target/release/meshway). PICTURES=1 also writes the pictures of docs/.
set -euo pipefail

root=$(cd "$(dirname "$0")/.." && pwd)
program=${MESHWAY:-$root/target/release/meshway}

fail() { echo "test-web: $*" >&2; exit 1; }

[ -x "$program" ] || fail "$program is missing; make build, or set MESHWAY"
MESHWAY=$(realpath "$program")
export MESHWAY
command -v chromium >/dev/null || command -v chromium-headless-shell >/dev/null ||
  fail "no browser (Debian: apt-get install chromium)"
cd "$root/web"
[ -d node_modules ] || npm ci --ignore-scripts
npm run --silent check
# One file after the other: each has a service and a browser.
for tests in test/*.test.mjs; do
  node --test "$tests"
done
