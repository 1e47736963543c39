#!/usr/bin/env bash
# The recipes of docker/ for nginx and Caddy, as files of theirs with other ports and names: a cloud goes in and its mesh
# comes out, events come while the job runs, an upload that was cut goes on, and each request has the name of the proxy
# and the address of its client.
# Needs nginx, caddy, curl and openssl.
#
# MESHWAY: the program (target/release/meshway).
set -euo pipefail

root=$(cd "$(dirname "$0")/.." && pwd)
program=$(realpath -m "${MESHWAY:-$root/target/release/meshway}")
fail() { echo "proxy: $*" >&2; tail -n 8 "$work"/log "$work"/proxy.log >&2 || true; exit 1; }
PATH=$PATH:/usr/sbin
for tool in nginx caddy curl openssl; do
  command -v $tool >/dev/null || { echo "proxy: no $tool (Debian: apt-get install $tool)" >&2; exit 1; }
done

export MESHWAY_ALLOWED_HOSTS=mesh.example.org MESHWAY_TRUSTED_PROXIES=127.0.0.1/32
. "$root/scripts/served.sh"
openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj /CN=mesh.example.org \
  -addext subjectAltName=DNS:mesh.example.org -keyout "$work/key.pem" -out "$work/cert.pem" 2>/dev/null
free_port() { python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])'; }
"$program" sample uterus --points 2000 --output "$work/cloud.ply" >/dev/null
"$program" sample sphere --points 200000 --output "$work/large.ply" >/dev/null

ours() { # recipe: with what is here for what it names
  sed -e "s#127[.]0[.]0[.]1:8080#${address#http://}#" -e "s#/etc/ssl/mesh.example.org.pem#$work/cert.pem#" \
    -e "s#/etc/ssl/mesh.example.org.key#$work/key.pem#" "$root/docker/$1"
}
start_nginx() {
  # Its folders may not exist where only the program is there.
  { echo "daemon off; pid $work/nginx.pid; events {}"
    echo "http { access_log off; client_body_temp_path $work/body; proxy_temp_path $work/temp;"
    echo "fastcgi_temp_path $work/f; uwsgi_temp_path $work/u; scgi_temp_path $work/s;"
    ours nginx.conf | sed "s/listen 443/listen 127.0.0.1:$port/"
    echo "}"; } > "$work/nginx.conf"
  nginx -e "$work/proxy.log" -c "$work/nginx.conf" &
}
start_caddy() {
  { printf '%s\n' "{" "admin off" "auto_https disable_redirects" "https_port $port" "default_bind 127.0.0.1" "}"
    ours Caddyfile; } > "$work/Caddyfile"
  XDG_DATA_HOME=$work XDG_CONFIG_HOME=$work HOME=$work \
    caddy run --adapter caddyfile --config "$work/Caddyfile" > "$work/proxy.log" 2>&1 &
}

for proxy in nginx caddy; do
  port=$(free_port)
  "start_$proxy"
  besides_server=$!
  there=https://mesh.example.org:$port
  ask() { curl -fsS --max-time 300 --cacert "$work/cert.pem" --resolve "mesh.example.org:$port:127.0.0.1" "$@"; }
  for _ in $(seq 100); do
    ask -o "$work/answer" "$there/readyz" 2>/dev/null && break
    kill -0 "$besides_server" 2>/dev/null || fail "$proxy did not start"
    sleep 0.1
  done

  # Events of a job come while it runs: it is cancelled only after one has come.
  location=$(ask -D - -o "$work/answer" --data-binary @"$work/large.ply" "$there/v1/jobs?preset=fine" |
    tr -d '\r' | sed -n 's/^location: //Ip')
  [ -n "$location" ] || fail "$proxy: a large cloud makes no job"
  ask -N "$there$location/events" > "$work/events" &
  stream=$!
  for _ in $(seq 600); do grep -q '^data:' "$work/events" && break; sleep 0.1; done
  grep -q '^data:' "$work/events" || fail "$proxy keeps the events back"
  ask -o "$work/answer" -X POST "$there$location/cancel"
  wait "$stream" || fail "$proxy: the events did not end with the job"

  # A cloud goes in, and its mesh comes out.
  ask -H 'Prefer: wait=60' -H 'Accept: model/obj' --data-binary @"$work/cloud.ply" -o "$work/mesh.obj" \
    "$there/v1/jobs?preset=fast"
  grep -q '^f ' "$work/mesh.obj" || fail "$proxy: no mesh came"

  # What came of an upload that is cut is there, and it goes on.
  upload=$(ask -X POST -H 'Upload-Complete: ?0' -D - -o "$work/answer" "$there/v1/uploads" |
    tr -d '\r' | sed -n 's/^location: //Ip')
  type='Content-Type: application/partial-upload'
  ask -X PATCH -H 'Upload-Offset: 0' -H 'Upload-Complete: ?0' -H "$type" --limit-rate 200k --max-time 2 \
    --data-binary @"$work/large.ply" "$there$upload" 2>/dev/null && fail "$proxy: the upload was not cut"
  for _ in $(seq 100); do
    offset=$(ask -I "$there$upload" | tr -d '\r' | sed -n 's/^upload-offset: //Ip')
    [ "$offset" -gt 0 ] && break
    sleep 0.1
  done
  [ "$offset" -gt 0 ] || fail "$proxy holds an upload back until it is whole"
  tail -c "+$((offset + 1))" "$work/large.ply" | ask -X PATCH -H "Upload-Offset: $offset" -H 'Upload-Complete: ?1' \
    -H "$type" --data-binary @- -o "$work/answer" "$there$upload"
  grep -q '"cloud_id":"cld_' <(ask "$there$upload") || fail "$proxy: the upload did not become a cloud"

  # Another name is refused by the service, or is none of the sites of the proxy.
  jobs=$(ask "$there/v1/jobs"); grep -q '"items"' <<<"$jobs" || fail "$proxy: no list of jobs"
  # Who asks is the client, not the proxy, and not whoever the client says.
  [ $proxy = nginx ] && client=127.0.0.2 || client=127.0.0.3
  ask --interface $client -H 'X-Forwarded-For: 6.6.6.6' -o "$work/answer" "$there/v1/jobs"
  grep -q "client.address=$client[ }]" "$work/log" || fail "$proxy: the address of the client is not known"
  grep -q 'client.address=6' "$work/log" && fail "$proxy: a client says who it is"
  jobs=$(ask -H 'Host: other.example.org' "$there/v1/jobs" 2>/dev/null || true)
  [ -z "$jobs" ] || fail "$proxy: another name is answered: $jobs"
  kill "$besides_server"
  wait "$besides_server" 2>/dev/null || true
  besides_server=
done
echo "proxy: nginx and Caddy pass clouds, meshes, events and uploads that go on"
