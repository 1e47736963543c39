#!/usr/bin/env bash
# TLS on the way to Postgres and to an object store, with certificates of an authority of our own: a job is done over
# both, and a server with another name, of another authority or without TLS is refused with a reason.
#
#   scripts/postgres.sh scripts/s3.sh scripts/backends-tls.sh
#
# Needs openssl, nginx, curl and psql.
#
# MESHWAY: the program (target/release/meshway).
set -euo pipefail

root=$(cd "$(dirname "$0")/.." && pwd)
program=$(realpath -m "${MESHWAY:-$root/target/release/meshway}")
fail() { echo "backends-tls: $*" >&2; exit 1; }
PATH=$PATH:/usr/sbin
for tool in openssl nginx curl psql; do
  command -v $tool >/dev/null || fail "no $tool"
done
[ -x "$program" ] || fail "$program is missing; make build, or set MESHWAY"
[ -n "${MESHWAY_TEST_POSTGRES_DATA:-}" ] || fail "there is no Postgres: run this by scripts/postgres.sh"
[ -n "${MESHWAY_TEST_OBJECTS:-}" ] || fail "there is no object store: run this by scripts/s3.sh"

work=$(mktemp -d)
proxy=
server=
tidy() {
  for process in $server $proxy; do
    kill "$process" 2>/dev/null || true
    wait "$process" 2>/dev/null || true
  done
  rm -rf "$work"
}
trap tidy EXIT

# Two authorities, and of the first one a certificate for localhost.
for name in ours other; do
  openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj "/CN=authority $name" \
    -keyout "$work/$name.key" -out "$work/$name.pem" 2>/dev/null
done
openssl req -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -subj /CN=localhost -keyout "$work/server.key" \
  -out "$work/server.csr" 2>/dev/null
openssl x509 -req -in "$work/server.csr" -CA "$work/ours.pem" -CAkey "$work/ours.key" -CAcreateserial -days 2 \
  -extfile <(echo subjectAltName=DNS:localhost) -out "$work/server.pem" 2>/dev/null

# Postgres with TLS.
data=$MESHWAY_TEST_POSTGRES_DATA
cp "$work/server.pem" "$data/server.crt"
cp "$work/server.key" "$data/server.key"
owner=$(stat -c %U "$data")
chown "$owner" "$data/server.crt" "$data/server.key"
chmod 600 "$data/server.key"
psql -q "$MESHWAY_TEST_DATABASE" -c "ALTER SYSTEM SET ssl = on" -c "SELECT pg_reload_conf()" -c "CREATE DATABASE of_tls" >/dev/null
port=${MESHWAY_TEST_DATABASE##*:}
port=${port%%/*}
for _ in $(seq 50); do
  psql -q "postgres://postgres@localhost:$port/postgres?sslmode=require" -c "SELECT 1" >/dev/null 2>&1 && break
  sleep 0.1
done

# The object store behind a proxy that speaks TLS.
there=$(sed 's/.*endpoint=http:..\([^&]*\).*/\1/' <<<"$MESHWAY_TEST_OBJECTS")
tls=$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
cat > "$work/nginx.conf" <<SETTINGS
daemon off; pid $work/nginx.pid; events {}
http {
  access_log off; client_body_temp_path $work/body; proxy_temp_path $work/temp;
  fastcgi_temp_path $work/f; uwsgi_temp_path $work/u; scgi_temp_path $work/s;
  server {
    listen 127.0.0.1:$tls ssl; ssl_certificate $work/server.pem; ssl_certificate_key $work/server.key;
    client_max_body_size 0;
    location / { proxy_pass http://$there; proxy_set_header Host \$http_host; proxy_request_buffering off; }
  }
}
SETTINGS
nginx -e "$work/proxy.log" -c "$work/nginx.conf" &
proxy=$!
for _ in $(seq 100); do
  (exec 3<>"/dev/tcp/127.0.0.1/$tls") 2>/dev/null && break
  kill -0 "$proxy" 2>/dev/null || fail "nginx did not start: $(cat "$work/proxy.log")"
  sleep 0.1
done

database() { # host, authority
  echo "postgres://postgres@$1:$port/of_tls?sslmode=verify-full&sslrootcert=$work/$2.pem"
}
objects() { # host, authority, prefix
  echo "s3://tests/$3?endpoint=https://$1:$tls&region=us-east-1&ca=$work/$2.pem"
}
serve() { "$program" serve --listen 127.0.0.1:0 --disk-reserve-mib 1 --disk-reserve-percent 0 "$@"; }

refused() { # what, expected words, flags…
  local what=$1 words=$2 told
  shift 2
  told=$(serve --data-dir "$work/refused" "$@" 2>&1) && fail "$what was taken"
  grep -qiE "$words" <<<"$told" || fail "$what is refused without the reason: $told"
  grep -q panicked <<<"$told" && fail "$what: $told"
  rm -rf "$work/refused"
}
refused "a database with another name" "name|NotValidForName" --database "$(database 127.0.0.1 ours)"
refused "a database of another authority" "certificate|UnknownIssuer" --database "$(database localhost other)"
refused "a database without a certificate to check" "verify-full" --database "postgres://postgres@db.example/of_tls?sslmode=require"
refused "an object store with another name" "certificate|name" --objects "$(objects 127.0.0.1 ours a)"
refused "an object store of another authority" "certificate|UnknownIssuer" --objects "$(objects localhost other b)"
refused "an object store without its authority" "certificate|UnknownIssuer" \
  --objects "s3://tests/c?endpoint=https://localhost:$tls&region=us-east-1"
refused "a file of authorities that is not there" "none.pem" --objects "$(objects localhost none d)"
refused "an object store elsewhere without TLS" "https://" --objects "s3://tests/e?endpoint=http://s3.example"

# All of a job over both.
: > "$work/log"
serve --data-dir "$work/data" --database "$(database localhost ours)" --objects "$(objects localhost ours life)" \
  > "$work/log" 2>&1 &
server=$!
for _ in $(seq 200); do
  address=$(grep -o 'http://127[.]0[.]0[.]1:[0-9]*' "$work/log" | head -1 || true)
  [ -n "$address" ] && break
  kill -0 "$server" 2>/dev/null || fail "the service did not start: $(cat "$work/log")"
  sleep 0.1
done
[ -n "$address" ] || fail "the service did not say where it listens"
"$program" sample sphere --points 500 --output "$work/cloud.ply" >/dev/null
job='{"preset": "fast", "settings": {"training": {"max_evaluations": 30}, "surface": {"resolution": 24}}}'
curl -fsS --max-time 300 -H 'Prefer: wait=60' -H 'Accept: model/obj' -F file=@"$work/cloud.ply" -F "job=$job" \
  -o "$work/mesh.obj" "$address/v1/jobs"
grep -q '^f ' "$work/mesh.obj" || fail "no mesh came over TLS: $(cat "$work/mesh.obj") $(tail -5 "$work/log")"
in_clear=$(psql -qtA "$MESHWAY_TEST_DATABASE" -c "SELECT COUNT(*) FROM pg_stat_ssl JOIN pg_stat_activity USING (pid)
  WHERE datname = 'of_tls' AND NOT ssl")
[ "$in_clear" = 0 ] || fail "$in_clear connections to the database are without TLS"
"$program" check --hashes --data-dir "$work/data" --database "$(database localhost ours)" >/dev/null ||
  fail "a check over TLS finds something"
echo "backends-tls: Postgres and the object store are reached by TLS, and refused where they are others"
