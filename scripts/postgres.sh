#!/usr/bin/env bash
# Runs a command beside a Postgres server of its own, which goes with it: what it holds is for tests, and
# is not kept safe from a power cut unless FSYNC=on.
#
#   scripts/postgres.sh COMMAND [ARGUMENT…]
#
# The command finds the server's address in MESHWAY_TEST_DATABASE; its data in MESHWAY_TEST_POSTGRES_DATA,
# and what starts it again after it was killed in MESHWAY_TEST_POSTGRES_START. Needs Debian's
# postgresql-15, or later.
set -euo pipefail

fail() { echo "postgres: $*" >&2; exit 1; }

bin=$(find /usr/lib/postgresql -maxdepth 2 -name bin 2>/dev/null | sort -V | tail -1)
[ -n "$bin" ] || fail "there is no server (Debian: apt-get install postgresql-15)"

work=$(mktemp -d)
# It refuses to run as root.
as=()
if [ "$(id -u)" = 0 ]; then
  as=(setpriv --reuid=postgres --regid=postgres --init-groups)
  chown postgres "$work"
fi
data=$work/data
stop() {
  (cd "$work" && "${as[@]}" "$bin/pg_ctl" -D "$data" -m immediate -w stop >/dev/null 2>&1) || true
  rm -rf "$work"
}
trap stop EXIT

cd "$work"
"${as[@]}" "$bin/initdb" -D "$data" -A trust -U postgres -N -E UTF8 --locale=C.UTF-8 >"$work/log.initdb" \
  || fail "$(cat "$work/log.initdb")"
# A port that is free, or another one.
for try in 1 2 3 4 5; do
  port=$((20000 + RANDOM % 12000))
  cat >>"$data/postgresql.conf" <<SETTINGS
port = $port
listen_addresses = '127.0.0.1'
unix_socket_directories = '$work'
fsync = ${FSYNC:-off}
full_page_writes = ${FSYNC:-off}
max_connections = 500
SETTINGS
  start="${as[*]} $bin/pg_ctl -D $data -l $data/log -w start"
  $start >/dev/null 2>&1 && break
  [ "$try" != 5 ] || fail "it does not start: $(tail -3 "$data/log")"
done
cd "$OLDPWD"

export MESHWAY_TEST_DATABASE=postgres://postgres@127.0.0.1:$port/postgres
export MESHWAY_TEST_POSTGRES_DATA=$data
export MESHWAY_TEST_POSTGRES_START=$start
"$@"
