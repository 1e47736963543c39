#!/usr/bin/env bash
# Installs clients/python as a user does, holds its types, and drives it against a served instance, over
# connections that are cut; then the module for 3D Slicer, as far as it can be without Slicer.
#
# MESHWAY: the program (target/release/meshway).
set -euo pipefail

root=$(cd "$(dirname "$0")/.." && pwd)
program=${MESHWAY:-$root/target/release/meshway}

fail() { echo "python client: $*" >&2; exit 1; }

export PYTHONDONTWRITEBYTECODE=1
. "$root/scripts/served.sh"

tools=$root/target/python-client-venv
if [ ! -x "$tools/bin/mypy" ]; then
  python3 -m venv "$tools" || fail "no Python environment (Debian: apt-get install python3-venv)"
  "$tools/bin/pip" install --quiet --disable-pip-version-check mypy==2.4.1 numpy trimesh
fi
# From a copy: building leaves files beside the sources.
cp -r "$root/clients/python" "$work/python"
"$tools/bin/pip" install --quiet --disable-pip-version-check --force-reinstall --no-deps "$work/python"
"$tools/bin/pip" install --quiet --disable-pip-version-check "$work/python"

(cd "$work/python" && "$tools/bin/mypy" --no-error-summary src) || fail "the types do not hold"
cd "$work"
MESHWAY_URL=$address "$tools/bin/python" -W ignore::ResourceWarning "$root/clients/python/tests/test_client.py"
MESHWAY_URL=$address "$tools/bin/python" -W ignore::ResourceWarning "$root/clients/slicer/tests/test_module.py"
"$tools/bin/python" "$root/clients/python/examples/points.py" "$address"
[ -s mesh.stl ] || fail "the example wrote no mesh"
