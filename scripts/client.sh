#!/usr/bin/env bash
# Generates a Python client from openapi.yaml, without a warning, and drives it through a whole flow
# against a served instance: what the contract says must be what a typed client can use.
#
# MESHWAY: the program (target/release/meshway).
set -euo pipefail

version=0.29.1
root=$(cd "$(dirname "$0")/.." && pwd)
program=${MESHWAY:-$root/target/release/meshway}
package=openapi-python-client

fail() { echo "client: $*" >&2; exit 1; }

. "$root/scripts/served.sh"

# The generator formats what it wrote with a ruff that it finds.
said=$(PATH="$tools/bin:$PATH" "$tools/bin/openapi-python-client" generate --path "$root/openapi.yaml" \
  --config "$root/scripts/client.yaml" --output-path "$work/client" 2>&1) || fail "$said"
! grep -qi warning <<<"$said" || fail "$said"

"$program" sample sphere --points 500 --output "$work/sphere.ply" >/dev/null
PYTHONPATH=$work/client "$tools/bin/python" "$root/scripts/client.py" "$address" "$work/sphere.ply"
