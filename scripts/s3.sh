#!/usr/bin/env bash
# Runs a command beside an object store of its own, which ends with it: `./scripts/s3.sh cargo test`.
# Tests find the store by MESHWAY_TEST_OBJECTS, its files by MESHWAY_TEST_OBJECTS_FOLDER, and the program,
# of which tests of faults start more, by MESHWAY_TEST_S3_SERVER. Installs the program where it is missing.
set -euo pipefail
version=0.14.1
tools=${XDG_CACHE_HOME:-$HOME/.cache}/meshway/tools
program=$tools/bin/s3s-fs

[ "$#" -gt 0 ] || { echo "usage: scripts/s3.sh COMMAND..." >&2; exit 2; }
if [ "$("$program" --version 2>/dev/null || true)" != "s3s-fs $version" ]; then
  cargo install --quiet --locked --root "$tools" s3s-fs --version "$version" --features binary
fi

work=$(mktemp -d)
server=
tidy() {
  if [ -n "$server" ]; then
    kill "$server" 2>/dev/null || true
    wait "$server" 2>/dev/null || true
  fi
  rm -rf "$work"
}
trap tidy EXIT
mkdir "$work/tests"

export AWS_ACCESS_KEY_ID=tests AWS_SECRET_ACCESS_KEY=secret-of-tests
port=$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
"$program" --host 127.0.0.1 --port "$port" --access-key "$AWS_ACCESS_KEY_ID" \
  --secret-key "$AWS_SECRET_ACCESS_KEY" "$work" > "$work/.log" 2>&1 &
server=$!
for _ in $(seq 100); do
  (exec 3<>"/dev/tcp/127.0.0.1/$port") 2>/dev/null && break
  kill -0 "$server" 2>/dev/null || { cat "$work/.log" >&2; exit 1; }
  sleep 0.1
done

export MESHWAY_TEST_OBJECTS="s3://tests?endpoint=http://127.0.0.1:$port&region=us-east-1"
export MESHWAY_TEST_OBJECTS_FOLDER=$work/tests
export MESHWAY_TEST_S3_SERVER=$program
"$@"
