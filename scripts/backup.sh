#!/usr/bin/env bash
# Backups by doing: of a service under load one is taken, restored elsewhere, checked and served, and every job that
# had been answered before it began is there with its mesh. First a folder with SQLite, then Postgres with an object
# store; docs/operations.md says the same in words.
#
#   scripts/postgres.sh scripts/s3.sh scripts/backup.sh
#
# Needs python3, curl, pg_dump and psql.
#
# MESHWAY: the program (target/release/meshway).
set -euo pipefail

root=$(cd "$(dirname "$0")/.." && pwd)
program=$(realpath -m "${MESHWAY:-$root/target/release/meshway}")
fail() { echo "backup: $*" >&2; tail -n 5 "$work"/*.log >&2 || true; exit 1; }
work=$(mktemp -d)
server=
load=
tidy() {
  for process in $load $server; do
    kill "$process" 2>/dev/null || true
    wait "$process" 2>/dev/null || true
  done
  rm -rf "$work"
}
trap tidy EXIT
[ -x "$program" ] || fail "$program is missing; make build, or set MESHWAY"
for tool in curl pg_dump psql python3; do
  command -v $tool >/dev/null || fail "no $tool"
done
job='{"preset": "fast", "settings": {"training": {"max_evaluations": 30}, "surface": {"resolution": 24}}}'

serve() { # log, flags…
  local log=$1
  shift
  : > "$log"
  "$program" serve --listen 127.0.0.1:0 --disk-reserve-mib 1 --disk-reserve-percent 0 --workers 1 "$@" > "$log" 2>&1 &
  server=$!
  for _ in $(seq 300); do
    address=$(grep -o 'http://127[.]0[.]0[.]1:[0-9]*' "$log" | head -1 || true)
    [ -n "$address" ] && return
    kill -0 "$server" 2>/dev/null || fail "the service did not start: $(cat "$log")"
    sleep 0.1
  done
  fail "the service did not say where it listens"
}
stop() {
  kill "$server"
  wait "$server" || true
  server=
}
# Jobs one after the other, each of a cloud of its own; the ids of those that have succeeded are noted.
submit() {
  local number=0 answer
  while true; do
    number=$((number + 1))
    python3 -c 'import math, sys
for k in range(400):
    z = 1 - (2 * k + 1) / 400
    turn = k * math.pi * (3 - math.sqrt(5))
    r = math.sqrt(1 - z * z) * (1 + int(sys.argv[1]) * 1e-6)
    print(r * math.cos(turn), r * math.sin(turn), z)' "$number" > "$work/next.xyz"
    answer=$(curl -sS --max-time 100 -H 'Prefer: wait=60' -F "file=@$work/next.xyz" -F "job=$job" "$address/v1/jobs" 2>/dev/null) ||
      continue
    python3 -c 'import json, sys
job = json.load(sys.stdin)
if job.get("status") == "succeeded": print(job["id"], flush=True)' <<<"$answer" >> "$work/done"
  done
}
# A checkpoint goes with the end of its job, also between the two halves of a backup: the job begins anew then. Nothing
# else may be missing.
whole() { # what, flags…
  local what=$1 found
  shift
  found=$("$program" check --hashes --json "$@" 2>/dev/null) || true
  python3 -c 'import json, sys
sys.exit(any(found["kind"] != "checkpoint" for found in json.load(sys.stdin)["findings"]))' <<<"$found" ||
    fail "$what is not whole: $found"
}
loaded() {
  : > "$work/done"
  submit &
  load=$!
  for _ in $(seq 600); do
    [ "$(wc -l < "$work/done")" -ge 5 ] && break
    sleep 0.1
  done
  [ "$(wc -l < "$work/done")" -ge 5 ] || fail "no jobs are done"
  cp "$work/done" "$work/before"
}
unloaded() {
  kill "$load"
  wait "$load" 2>/dev/null || true
  load=
}
# All that was done before the backup began is there.
all_there() {
  while read -r id; do
    curl -fsS -o "$work/mesh.ply" "$address/v1/jobs/$id/mesh.ply" || fail "the mesh of $id is not there"
    head -c 3 "$work/mesh.ply" | grep -q ply || fail "the mesh of $id is none"
  done < "$work/before"
}

# A folder. The rows first, then the bytes: copied while the service runs.
serve "$work/first.log" --data-dir "$work/data"
loaded
began=$SECONDS
"$root/scripts/backup-folder.sh" "$work/data" "$work/backup"
took=$((SECONDS - began))
unloaded
stop
cp -a "$work/backup" "$work/restored"
whole "the restored folder" --data-dir "$work/restored"
serve "$work/second.log" --data-dir "$work/restored"
all_there
stop
echo "backup: a folder of $(wc -l < "$work/before") jobs was taken in $took s, restored and served"

# Postgres and an object store. The rows first, then the objects.
address_of() { echo "${MESHWAY_TEST_DATABASE%/*}/$1"; }
psql -q "$MESHWAY_TEST_DATABASE" -c "CREATE DATABASE backup_of" -c "CREATE DATABASE backup_to"
objects() { echo "${MESHWAY_TEST_OBJECTS%%\?*}/$1?${MESHWAY_TEST_OBJECTS#*\?}"; }
serve "$work/third.log" --data-dir "$work/node" --database "$(address_of backup_of)" --objects "$(objects backup-of)"
loaded
began=$SECONDS
pg_dump -Fc -f "$work/rows.dump" "$(address_of backup_of)"
# As a tool of the store would: `rclone copy`, `aws s3 sync`.
copied() { cp -a "$1" "$2" 2>/dev/null || [ -d "$2" ]; }
copied "$MESHWAY_TEST_OBJECTS_FOLDER/backup-of" "$work/objects"
took=$((SECONDS - began))
unloaded
stop
pg_restore -d "$(address_of backup_to)" --no-owner "$work/rows.dump"
cp -a "$work/objects" "$MESHWAY_TEST_OBJECTS_FOLDER/backup-to"
psql -q "$(address_of backup_to)" -c "DELETE FROM meta WHERE name = 'folder'" \
  -c "UPDATE meta SET value = '$(objects backup-to)' WHERE name = 'objects'"
place=(--data-dir "$work/elsewhere" --database "$(address_of backup_to)" --objects "$(objects backup-to)")
whole "the restored database" "${place[@]}"
serve "$work/fourth.log" "${place[@]}"
all_there
stop
echo "backup: a database and a bucket of $(wc -l < "$work/before") jobs were taken in $took s, restored and served"
