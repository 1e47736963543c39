#!/usr/bin/env bash
# Lays the built program down with its libraries: install.sh PREFIX, below DESTDIR if that is set.
#
# The libraries go into a folder of the program's own: a libgomp of libtorch in /usr/local/lib would be
# taken by others, too. The program looks for them in ../lib (build.rs) of the file that the link in
# PREFIX/bin leads to, so the whole may be moved.
set -euo pipefail
cd "$(dirname "$0")/.."

prefix=${1:?usage: install.sh PREFIX}
program=${MESHWAY:-target/release/meshway}
[ -x "$program" ] || { echo "install: $program is missing; run make build" >&2; exit 1; }
root=${DESTDIR:-}$prefix
own=$root/lib/meshway

install -d "$root/bin" "$own/bin" "$own/lib" "$root/share/man/man1" "$root/share/doc/meshway" \
  "$root/share/bash-completion/completions" "$root/share/zsh/site-functions" \
  "$root/share/fish/vendor_completions.d"
install -m 755 "$program" "$own/bin/meshway"
for library in .libtorch/lib/*.so*; do
  install -m 644 "$(readlink -f "$library")" "$own/lib/$(basename "$library")"
done
ln -sfn ../lib/meshway/bin/meshway "$root/bin/meshway"

"$own/bin/meshway" man "$root/share/man/man1"
"$own/bin/meshway" completions bash > "$root/share/bash-completion/completions/meshway"
"$own/bin/meshway" completions zsh > "$root/share/zsh/site-functions/_meshway"
"$own/bin/meshway" completions fish > "$root/share/fish/vendor_completions.d/meshway.fish"
install -m 644 LICENSE-APACHE LICENSE-MIT README.md CHANGELOG.md dist/meshway.service "$root/share/doc/meshway"
install -m 644 .libtorch/lib/LICENSE "$root/share/doc/meshway/LICENSE-libtorch"
