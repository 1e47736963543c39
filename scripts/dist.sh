#!/usr/bin/env bash
# Makes target/dist/meshway-VERSION-SYSTEM.tar.gz: the program with its libraries, which runs from any
# folder and for any user. Then unpacks it elsewhere and tries it, for another user where that can be.
set -euo pipefail
cd "$(dirname "$0")/.."

version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
name=meshway-$version-$(uname -s | tr '[:upper:]' '[:lower:]')-$(uname -m)
out=target/dist
rm -rf "${out:?}/$name"
./scripts/install.sh "$PWD/$out/$name"
tar --owner=0 --group=0 --numeric-owner -C "$out" -czf "$out/$name.tar.gz" "$name"

trial=$(mktemp -d)
trap 'rm -rf "$trial"' EXIT
chmod 755 "$trial"
tar -C "$trial" -xzf "$out/$name.tar.gz"
as=()
[ "$(id -u)" -ne 0 ] || as=(setpriv --reuid=65534 --regid=65534 --clear-groups)
# The libraries must be those that it carries: the builder's own are not looked at.
printed=$(cd / && env -i "${as[@]}" "$trial/$name/bin/meshway" --version)
[ "$printed" = "meshway $version" ] || { echo "dist: it prints $printed" >&2; exit 1; }
(cd / && env -i "${as[@]}" "$trial/$name/bin/meshway" sample sphere -n 300 -o -) |
  (cd / && env -i "${as[@]}" "$trial/$name/bin/meshway" reconstruct - -o - --format ply --preset fast -q) |
  head -c 3 | grep -qx ply || { echo "dist: it reconstructs nothing" >&2; exit 1; }
echo "$out/$name.tar.gz"
