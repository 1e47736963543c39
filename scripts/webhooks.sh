#!/usr/bin/env bash
# Webhooks before a receiver of others: the Python package of Standard Webhooks verifies each message, over TLS with an
# authority of the house. A job and a batch are told of, a receiver that fails at first gets the message again, and one with
# a certificate of another authority gets none. Needs curl, openssl and python3.
#
# MESHWAY: the program (target/release/meshway).
set -euo pipefail

root=$(cd "$(dirname "$0")/.." && pwd)
program=$(realpath -m "${MESHWAY:-$root/target/release/meshway}")
fail() { echo "webhooks: $*" >&2; tail -n 20 "${work:-/nowhere}/log" >&2 || true; exit 1; }

# The package has no program, by which served.sh would know it.
version=1.1.0
receiver_tools=$root/target/standardwebhooks-$version
if [ ! -e "$receiver_tools/made" ]; then
  python3 -m venv "$receiver_tools" || fail "no Python environment (Debian: apt-get install python3-venv)"
  "$receiver_tools/bin/pip" install --quiet --disable-pip-version-check "standardwebhooks==$version"
  touch "$receiver_tools/made"
fi

certificates=$(mktemp -d)
pair() { # authority: and a receiver of its
  local key=(-newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes)
  openssl req -x509 "${key[@]}" -days 2 -subj "/CN=$1" -keyout "$1-ca.key" -out "$1-ca.pem"
  openssl req "${key[@]}" -subj "/CN=receiver" -keyout "$1.key" -out "$1.csr"
  openssl x509 -req -in "$1.csr" -CA "$1-ca.pem" -CAkey "$1-ca.key" -days 2 -out "$1.pem" \
    -extfile <(echo "subjectAltName=DNS:localhost")
}
(cd "$certificates"; pair house; pair stranger) 2>/dev/null
read -r port other <<<"$(python3 -c '
import socket
ends = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
print(*(end.getsockname()[1] for end in ends))')"
export MESHWAY_WEBHOOK_NETWORKS=127.0.0.0/8,::1/128 MESHWAY_WEBHOOK_PORTS=$port,$other
export MESHWAY_WEBHOOK_CA=$certificates/house-ca.pem
scopes=read,write,admin
. "$root/scripts/served.sh"
mv "$certificates" "$work/certificates"

cat > "$work/receiver.py" <<'PYTHON'
"""Prints a line for each message that comes over TLS: verified or not, its type, its data. Refuses the first one."""
import json, ssl, sys, threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from standardwebhooks.webhooks import Webhook, WebhookVerificationError

folder, *ports = sys.argv[1:]
first = threading.Event()

class Receiver(BaseHTTPRequestHandler):
    def do_POST(self):
        body = self.rfile.read(int(self.headers["content-length"]))
        try:
            message = Webhook(open(folder + "/secret").read().strip()).verify(body, dict(self.headers))
            told = ["verified", message["type"], json.dumps(message["data"]), self.headers["webhook-id"]]
        except WebhookVerificationError as error:
            told = ["refused", str(error)]
        print(*told, flush=True)
        self.send_response(204 if first.is_set() else 500)
        first.set()
        self.end_headers()
    def log_message(self, *_):
        pass

for port, name in zip(ports, ("house", "stranger")):
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(f"{folder}/certificates/{name}.pem", f"{folder}/certificates/{name}.key")
    server = ThreadingHTTPServer(("127.0.0.1", int(port)), Receiver)
    server.socket = context.wrap_socket(server.socket, server_side=True)
    threading.Thread(target=server.serve_forever).start()
print("ready", flush=True)
PYTHON
"$receiver_tools/bin/python" "$work/receiver.py" "$work" "$port" "$other" > "$work/seen" &
besides_server=$!
for _ in $(seq 100); do grep -q ready "$work/seen" && break; sleep 0.1; done

ask() { curl -fsS --max-time 120 -H "Authorization: Bearer $key" "$@"; }
member() { python3 -c 'import json, sys; print(json.load(sys.stdin)[sys.argv[1]])' "$1"; }
hook() { ask -H 'Content-Type: application/json' -d "{\"url\": \"$1\"}" "$address/v1/webhooks"; }
sees() { # pattern: waits for a line
  for _ in $(seq 600); do grep -q "$1" "$work/seen" && return; sleep 0.1; done
  cat "$work/seen" >&2
  fail "no message came that is $1"
}

made=$(hook "https://localhost:$port/hook")
member secret <<<"$made" > "$work/secret"
id=$(member id <<<"$made")
"$program" sample sphere --points 300 --output "$work/cloud.ply" >/dev/null
job=$(ask -H 'Prefer: wait=60' --data-binary @"$work/cloud.ply" "$address/v1/jobs?preset=fast" | member id)
# Refused at first, and sent again with the same id.
sees "verified job.succeeded .*$job"
for _ in $(seq 200); do [ "$(grep -c "verified job.succeeded .*$job" "$work/seen")" = 2 ] && break; sleep 0.1; done
[ "$(grep "$job" "$work/seen" | sort -u | wc -l)" = 1 ] || fail "the second try is another message"
[ "$(grep -c "$job" "$work/seen")" = 2 ] || fail "a message that was refused did not come again"
cloud=$(ask "$address/v1/jobs/$job" | member cloud_id)
ask -H 'Content-Type: application/json' -d "{\"clouds\": [\"$cloud\", \"$cloud\"], \"preset\": \"fast\"}" \
  "$address/v1/batches" -o "$work/answer"
sees 'verified batch.ended .*"succeeded": 2'
# Signed with the new secret as well as with the old one.
ask -X POST "$address/v1/webhooks/$id/secret" | member secret > "$work/new"
ask -X POST "$address/v1/webhooks/$id/test" -o "$work/answer"
sees 'verified webhook.test'
mv "$work/new" "$work/secret"
ask -X POST "$address/v1/webhooks/$id/test" -o "$work/answer"
for _ in $(seq 200); do [ "$(grep -c 'verified webhook.test' "$work/seen")" = 2 ] && break; sleep 0.1; done
[ "$(grep -c 'verified webhook.test' "$work/seen")" = 2 ] || fail "the new secret does not sign"
! grep -q refused "$work/seen" || fail "a message could not be verified"

# An impostor: the name is right, the authority is not.
stranger=$(hook "https://localhost:$other/" | member id)
lines=$(wc -l < "$work/seen")
message=$(ask -X POST "$address/v1/webhooks/$stranger/test" | member id)
for _ in $(seq 200); do
  error=$(ask "$address/v1/deliveries/$message" | member error)
  [ "$error" = None ] || break
  sleep 0.1
done
grep -q 'TLS: .*certificate' <<<"$error" || fail "an impostor is not told from the receiver: $error"
[ "$(wc -l < "$work/seen")" = "$lines" ] || fail "an impostor got a message"
# And plain HTTP to a place that is not of the house is refused at once.
status=$(curl -sS -o "$work/answer" -w '%{http_code}' -H "Authorization: Bearer $key" \
  -H 'Content-Type: application/json' -d '{"url": "http://169.254.169.254/latest/meta-data"}' "$address/v1/webhooks")
[ "$status" = 422 ] || fail "an address of the cloud's own services gives $status"
echo "webhooks: $(grep -c verified "$work/seen") messages verified by standardwebhooks $version"
