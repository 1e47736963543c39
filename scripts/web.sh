#!/usr/bin/env bash
# Builds the dashboard into web/dist, from where cargo takes it; does nothing where that is current.
# Without npm the program is built without the dashboard, unless MESHWAY_REQUIRE_WEB is set.
set -euo pipefail
cd "$(dirname "$0")/../web"

if ! command -v npm >/dev/null; then
  echo "web: npm is missing (Debian: apt-get install npm); the program will have a plain start page" >&2
  [ "${MESHWAY_REQUIRE_WEB:-0}" = 0 ] || exit 1
  exit 0
fi
# npm writes this file last.
if ! [ node_modules/.package-lock.json -nt package-lock.json ]; then
  npm ci --ignore-scripts
fi
npm run --silent build
