#!/usr/bin/env bash
# Uploads by a client of tus that is not ours (tus-js-client), over connections that are cut, and the lines of
# docs/service.md by curl in the words of the draft of the IETF, over a server that is killed.
#
# MESHWAY: the program (target/release/meshway).
set -euo pipefail

root=$(cd "$(dirname "$0")/.." && pwd)
program=$(realpath -m "${MESHWAY:-$root/target/release/meshway}")
scopes=read,write

fail() { echo "tus: $*" >&2; exit 1; }

# Installed once for a lock file.
check=$root/target/tus
mkdir -p "$check"
if ! cmp -s "$root/scripts/tus/package-lock.json" "$check/installed.json"; then
  cp "$root"/scripts/tus/package*.json "$check"
  npm ci --prefix "$check" --ignore-scripts --no-audit --no-fund --silent || fail "npm ci failed"
  cp "$check/package-lock.json" "$check/installed.json"
fi
cp "$root/scripts/tus/flow.mjs" "$check"

. "$root/scripts/served.sh"
"$program" sample sphere --points 60000 --output "$work/cloud.ply" >/dev/null
node "$check/flow.mjs" "$address" "$work/cloud.ply" "$key"

# Begun, cut, asked for, gone on with after the server was killed.
auth="Authorization: Bearer $key"
"$program" sample uterus --points 3000 --output "$work/other.ply" >/dev/null
upload=$(curl -fsS -X POST -H "$auth" -H 'Upload-Complete: ?0' -D - -o "$work/answer" "$address/v1/uploads" |
  tr -d '\r' | sed -n 's/^location: //p')
head -c 10000 "$work/other.ply" | curl -fsS -X PATCH -H "$auth" -H 'Upload-Offset: 0' -H 'Upload-Complete: ?0' \
  -H 'Content-Type: application/partial-upload' --data-binary @- "$address$upload"
kill -9 "$server"
wait "$server" 2>/dev/null || true
"$program" serve --listen "${address#http://}" --data-dir "$work/data" --disk-reserve-mib 1 \
  --disk-reserve-percent 0 --config "$work/keys.toml" > "$work/log2" 2>&1 &
server=$!
for _ in $(seq 100); do
  grep -q 'listening on' "$work/log2" && break
  sleep 0.1
done
at=$(curl -fsSI -H "$auth" "$address$upload" | tr -d '\r' | sed -n 's/^upload-offset: //p')
[ "$at" = 10000 ] || fail "the upload is at '$at' after the server was killed"
tail -c "+$((at + 1))" "$work/other.ply" | curl -fsS -X PATCH -H "$auth" -H "Upload-Offset: $at" -H 'Upload-Complete: ?1' \
  -H 'Content-Type: application/partial-upload' --data-binary @- "$address$upload" > "$work/cloud.json"
content=$(python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))["links"]["content"])' "$work/cloud.json")
curl -fsS -H "$auth" "$address$content" | cmp - "$work/other.ply" || fail "other bytes came"
echo "tus: gone on with by curl after the server was killed"
