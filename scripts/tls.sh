#!/usr/bin/env bash
# TLS of the service as curl and openssl see it: versions, certificates that change, slow handshakes, clients
# that must show a certificate. Needs curl, openssl and python3.
#
# MESHWAY: the program (target/release/meshway).
set -euo pipefail

root=$(cd "$(dirname "$0")/.." && pwd)
program=$(realpath -m "${MESHWAY:-$root/target/release/meshway}")
fail() { echo "tls: $*" >&2; cat "$work/log" >&2 || true; exit 1; }

work=$(mktemp -d)
server=
tidy() {
  [ -z "$server" ] || { kill "$server" 2>/dev/null || true; wait "$server" 2>/dev/null || true; }
  rm -rf "$work"
}
trap tidy EXIT
cd "$work"

authority() {
  openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj "/CN=$1" \
    -keyout "$1.key" -out "$1.pem" 2>/dev/null
}
signed() { # name, authority
  openssl req -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -subj "/CN=$1" -keyout "$1.key" -out "$1.csr" 2>/dev/null
  openssl x509 -req -in "$1.csr" -CA "$2.pem" -CAkey "$2.key" -days 2 -out "$1.pem" \
    -extfile <(printf 'subjectAltName=DNS:localhost,IP:127.0.0.1\n') 2>/dev/null
}
authority own; authority other
signed first own; signed second own; signed client own; signed stranger other
cp first.pem cert.pem; cp first.key key.pem

serve() {
  : > log
  "$program" serve --listen 127.0.0.1:0 --data-dir data --disk-reserve-mib 1 --disk-reserve-percent 0 \
    --tls-cert cert.pem --tls-key key.pem "$@" > log 2>&1 &
  server=$!
  for _ in $(seq 300); do
    address=$(grep -o 'https://127[.]0[.]0[.]1:[0-9]*' log | head -1 || true)
    [ -n "$address" ] && return
    kill -0 "$server" 2>/dev/null || fail "the service did not start"
    sleep 0.1
  done
  fail "the service did not say where it listens"
}
end() { kill "$server"; wait "$server" || true; server=; }
ask() { curl -sS --cacert own.pem -o answer -w '%{http_code}' "$@" "$address/v1/version"; }
subject() { openssl s_client -connect "${address#https://}" </dev/null 2>/dev/null | openssl x509 -noout -subject; }
becomes() {
  for _ in $(seq 150); do
    case $(subject) in *"$1") return ;; esac
    sleep 0.2
  done
  fail "the certificate did not become that of $1"
}

serve
for version in 1.2 1.3; do
  [ "$(ask --tlsv$version --tls-max $version)" = 200 ] || fail "no answer with TLS $version"
done
! ask --tlsv1.0 --tls-max 1.1 --ciphers DEFAULT@SECLEVEL=0 2>/dev/null || fail "TLS 1.1 is taken"
! curl -sS -o answer "http://${address#https://}/v1/version" 2>/dev/null || fail "plain HTTP is answered"
becomes first
probe() { "$program" health --listen "${address#https://}" "$@"; }
probe --tls-cert cert.pem || fail "the service with this certificate does not live"
said=$(probe --tls-cert second.pem 2>&1) && fail "a probe takes another certificate"
grep -q "another certificate" <<<"$said" || fail "$said"
! probe 2>/dev/null || fail "a probe without TLS is answered"

# A certificate that changes on the disk, one that is of no use, and a signal.
cp second.pem cert.pem; cp second.key key.pem
becomes second
echo nothing > cert.pem
kill -HUP "$server"
for _ in $(seq 100); do grep -q "is of no use" log && break; sleep 0.1; done
grep -q "is of no use" log || fail "a certificate of no use is not told of"
becomes second
cp first.pem cert.pem; cp first.key key.pem
kill -HUP "$server"
becomes first
end

# Who never ends a handshake loses the place to who comes, and is closed where nobody does.
serve --max-connections 1
python3 - "${address#https://}" <<'END'
import socket, sys
host, port = sys.argv[1].split(":")
def silent(first=b""):
    connection = socket.create_connection((host, int(port)))
    connection.settimeout(120)
    connection.sendall(first)
    return connection
def closed(connection):
    try:
        while connection.recv(4096):
            pass
    except ConnectionResetError:
        pass
first = silent()
second = silent(b"\x16\x03\x01\x02\x00\x01")
closed(first)
closed(second)
END
silence() { exec 9<>"/dev/tcp/127.0.0.1/${address##*:}"; }
silence
[ "$(ask)" = 200 ] || fail "a silent client shuts others out"
exec 9>&-
end

serve --tls-client-ca own.pem
! ask 2>/dev/null || fail "a client without a certificate is answered"
! ask --cert stranger.pem --key stranger.key 2>/dev/null || fail "a stranger is answered"
[ "$(ask --cert client.pem --key client.key)" = 200 ] || fail "a client with its certificate is refused"
end

serve --tls-client-ca own.pem --tls-client-auth optional
[ "$(ask -D head)" = 200 ] || fail "a client without a certificate is refused where none is needed"
grep -qi '^strict-transport-security: max-age=' head || fail "browsers are not told to stay on TLS"
[ "$(ask --cert client.pem --key client.key)" = 200 ] || fail "a client with its certificate is refused"
! ask --cert stranger.pem --key stranger.key 2>/dev/null || fail "a stranger is answered"
end

cp second.key key.pem
said=$("$program" serve --listen 127.0.0.1:0 --data-dir data --tls-cert cert.pem --tls-key key.pem 2>&1) &&
  fail "a key of another certificate is taken"
grep -q "cert.pem with key.pem" <<<"$said" || fail "$said"
said=$("$program" serve --data-dir data --tls-cert cert.pem 2>&1) && fail "a certificate without a key is taken"
grep -q "go together" <<<"$said" || fail "$said"
echo "tls: versions, probes, new certificates, silent clients, certificates of clients"
