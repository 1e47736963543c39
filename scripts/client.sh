#!/usr/bin/env bash
# Generates a Python client from openapi.yaml, without a warning, and drives it through a whole flow
# against a served instance: what the contract says must be what a typed client can use.
#
# MESHWAY: the program (target/release/meshway).
set -euo pipefail

version=0.29.1
root=$(cd "$(dirname "$0")/.." && pwd)
program=${MESHWAY:-$root/target/release/meshway}
tools=$root/target/openapi-python-client-$version

fail() { echo "client: $*" >&2; exit 1; }

[ -x "$program" ] || fail "$program is missing; make build, or set MESHWAY"
if [ ! -x "$tools/bin/openapi-python-client" ]; then
  python3 -m venv "$tools" || fail "no Python environment (Debian: apt-get install python3-venv)"
  "$tools/bin/pip" install --quiet --disable-pip-version-check "openapi-python-client==$version"
fi

. "$root/scripts/served.sh"

# The generator formats what it wrote with a ruff that it finds.
said=$(PATH="$tools/bin:$PATH" "$tools/bin/openapi-python-client" generate --path "$root/openapi.yaml" \
  --config "$root/scripts/client.yaml" --output-path "$work/client" 2>&1) || fail "$said"
! grep -qi warning <<<"$said" || fail "$said"

"$program" sample sphere --points 500 --output "$work/sphere.ply" >/dev/null
PYTHONPATH=$work/client "$tools/bin/python" "$root/scripts/client.py" "$address" "$work/sphere.ply"
