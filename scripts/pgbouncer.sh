#!/usr/bin/env bash
# Runs a command beside a PgBouncer in transaction mode, before the server that MESHWAY_TEST_DATABASE names:
#
#   scripts/postgres.sh scripts/pgbouncer.sh COMMAND [ARGUMENT…]
#
# The command finds it by MESHWAY_TEST_PGBOUNCER, its host and port. Few connections lead to the server, so that
# those of the command share them. Needs Debian's pgbouncer.
set -euo pipefail

fail() { echo "pgbouncer: $*" >&2; exit 1; }

PATH=$PATH:/usr/sbin
command -v pgbouncer >/dev/null || fail "there is none (Debian: apt-get install pgbouncer)"
[ -n "${MESHWAY_TEST_DATABASE:-}" ] || fail "there is no server: run this by scripts/postgres.sh"
there=${MESHWAY_TEST_DATABASE#*@}
there=${there%%/*}

work=$(mktemp -d)
bouncer=
stop() {
  if [ -n "$bouncer" ]; then
    kill "$bouncer" 2>/dev/null || true
    wait "$bouncer" 2>/dev/null || true
  fi
  rm -rf "$work"
}
trap stop EXIT

port=$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
cat >"$work/pgbouncer.ini" <<SETTINGS
[databases]
* = host=${there%:*} port=${there#*:} user=postgres
[pgbouncer]
listen_addr = 127.0.0.1
listen_port = $port
unix_socket_dir =
auth_type = any
pool_mode = transaction
default_pool_size = 4
max_client_conn = 500
# Tests make many databases, one after the other.
server_idle_timeout = 1
log_connections = 0
log_disconnections = 0
SETTINGS
# It refuses to run as root.
as=()
if [ "$(id -u)" = 0 ]; then
  as=(setpriv --reuid=postgres --regid=postgres --init-groups)
  chown -R postgres "$work"
fi
"${as[@]}" pgbouncer "$work/pgbouncer.ini" >"$work/log" 2>&1 &
bouncer=$!
for _ in $(seq 100); do
  (exec 3<>"/dev/tcp/127.0.0.1/$port") 2>/dev/null && break
  kill -0 "$bouncer" 2>/dev/null || fail "it does not start: $(cat "$work/log")"
  sleep 0.1
done

export MESHWAY_TEST_PGBOUNCER=127.0.0.1:$port
"$@"
