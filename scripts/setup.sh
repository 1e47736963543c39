#!/usr/bin/env bash
# Provides libtorch for the build and links it into the checkout as `.libtorch`.
#
# The CPU libraries are cut out of pinned PyPI wheels into a cache folder of the user, which every
# clone shares. A LIBTORCH set by the user wins: nothing is fetched, the link points there.
#
# Why wheels: they come through the ordinary package registry, pinned by hash. Why cut: the wheel is
# the CUDA build; its CPU library only names libcudart and libcupti (never calls them without a
# GPU), so an empty libtorch.so in front of libtorch_cpu.so leaves 470 MB of CUDA code out.
set -euo pipefail

version=2.13.0
python_abi=3.11   # which wheel to take; the libraries do not depend on Python
root=$(cd "$(dirname "$0")/.." && pwd)

fail() { echo "setup: $*" >&2; exit 1; }

link() { # the checkout's .libtorch -> $1; replaced only when it differs, so cargo sees no change
  [ "$(readlink "$root/.libtorch" 2>/dev/null || true)" = "$1" ] || ln -sfn "$1" "$root/.libtorch"
}

if [ -n "${LIBTORCH:-}" ]; then
  [ -f "$LIBTORCH/lib/libtorch_cpu.so" ] ||
    fail "LIBTORCH=$LIBTORCH has no lib/libtorch_cpu.so; unset it to have libtorch $version fetched"
  link "$(cd "$LIBTORCH" && pwd)"
  exit 0
fi

[ "$(uname -sm)" = "Linux x86_64" ] ||
  fail "wheels are pinned for Linux x86_64 only; set LIBTORCH to a libtorch $version for this system"
cache=${XDG_CACHE_HOME:-$HOME/.cache}/meshway
target=$cache/libtorch-$version-cpu
if [ ! -f "$target/lib/libtorch.so" ]; then
  for tool in g++ python3; do
    command -v "$tool" >/dev/null || fail "$tool is missing (Debian: apt-get install g++ python3 python3-pip)"
  done
  python3 -m pip --version >/dev/null 2>&1 || fail "pip is missing (Debian: apt-get install python3-pip)"
  mkdir -p "$cache"
  work=$(mktemp -d "$cache/fetch.XXXXXX")
  trap 'rm -rf "$work"' EXIT
  echo "setup: fetching libtorch $version (about 540 MB, once; kept in $target)" >&2
  cat > "$work/wheels.txt" <<PINS
torch==$version --hash=sha256:60fcdcb2f3876e21146cb4524ef06397d727ca9ad5f020818547e25075fe3cb7
nvidia-cuda-runtime==13.0.96 --hash=sha256:7f82250d7782aa23b6cfe765ecc7db554bd3c2870c43f3d1821f1d18aebf0548
nvidia-cuda-cupti==13.0.85 --hash=sha256:4eb01c08e859bf924d222250d2e8f8b8ff6d3db4721288cf35d14252a4d933c8
PINS
  python3 -m pip download --quiet --disable-pip-version-check --no-deps --require-hashes \
    --only-binary :all: --python-version "$python_abi" --platform manylinux_2_28_x86_64 \
    --platform manylinux2014_x86_64 --platform manylinux_2_25_x86_64 \
    --dest "$work/wheels" --requirement "$work/wheels.txt" >&2 ||
    fail "could not fetch the wheels; check the network, or set LIBTORCH to a libtorch $version"
  python3 - "$work" <<'PYTHON'
import glob, os, shutil, sys, zipfile

work = sys.argv[1]
wanted = {  # wheel -> what to take from it
    "torch-": ("torch/include/", "torch/lib/libtorch_cpu.so", "torch/lib/libc10.so", "torch/lib/libgomp.so.1",
               "torch-2.13.0.dist-info/licenses/LICENSE"),
    "nvidia_cuda_runtime-": ("libcudart.so.13",),
    "nvidia_cuda_cupti-": ("libcupti.so.13",),
}
out = os.path.join(work, "libtorch")
os.makedirs(os.path.join(out, "lib"))
for wheel, names in wanted.items():
    with zipfile.ZipFile(glob.glob(os.path.join(work, "wheels", wheel + "*.whl"))[0]) as archive:
        for entry in archive.namelist():
            if entry.endswith("/"):
                continue
            if entry.startswith("torch/include/"):
                path = os.path.join(out, entry[len("torch/"):])
            elif any(entry == name or entry.endswith("/lib/" + name) for name in names):
                path = os.path.join(out, "lib", os.path.basename(entry))
            else:
                continue
            os.makedirs(os.path.dirname(path), exist_ok=True)
            with archive.open(entry) as source, open(path, "wb") as sink:
                shutil.copyfileobj(source, sink, 1 << 20)
PYTHON
  lib=$work/libtorch/lib
  for file in libtorch_cpu.so libc10.so libgomp.so.1 libcudart.so.13 libcupti.so.13; do
    [ -f "$lib/$file" ] || fail "the pinned wheels hold no $file"
  done
  echo | g++ -shared -x c++ - -o "$lib/libtorch.so" -Wl,-soname,libtorch.so -Wl,--no-as-needed \
    -L "$lib" -ltorch_cpu -lc10 -Wl,--allow-shlib-undefined -Wl,-rpath,'$ORIGIN'
  echo "$version" > "$work/libtorch/build-version"
  # Another clone may have finished first: then its copy is as good as ours.
  mv -T "$work/libtorch" "$target" 2>/dev/null || [ -f "$target/lib/libtorch.so" ] ||
    fail "could not move libtorch into $target"
fi
link "$target"
