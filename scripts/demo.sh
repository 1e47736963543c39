#!/usr/bin/env bash
# The example of `make demo`, over HTTP: starts the service, uploads a uterus with a hole in its points,
# follows the job's events, downloads the mesh, stops the service. Everything lands in demo/.
set -euo pipefail
cd "$(dirname "$0")/.."
meshway=target/release/meshway
command -v curl >/dev/null || { echo "demo: curl is missing (Debian: apt-get install curl)" >&2; exit 1; }
rm -rf demo && mkdir -p demo
run() { printf '\n$ %s\n' "$*" >&2; "$@"; }

run "$meshway" sample uterus --points 2000 --interior 100 --missing 10 --seed 3 -o demo/uterus.ply

printf '\n$ %s serve --listen 127.0.0.1:0 --data-dir demo/data &\n' "$meshway"
# A small reserve: the example shall run on a nearly full disk, too.
"$meshway" serve --listen 127.0.0.1:0 --data-dir demo/data --disk-reserve-mib 64 --disk-reserve-percent 0 \
  > demo/server.log 2>&1 &
server=$!
trap 'kill "$server" 2>/dev/null || true; wait "$server" 2>/dev/null || true' EXIT
address=
for _ in $(seq 100); do
  address=$(grep -o 'http://127[.]0[.]0[.]1:[0-9]*' demo/server.log | head -1 || true)
  [ -n "$address" ] && break
  kill -0 "$server" 2>/dev/null || break
  sleep 0.1
done
[ -n "$address" ] || { cat demo/server.log >&2; echo "demo: the service did not start" >&2; exit 1; }

run curl -fsS --data-binary @demo/uterus.ply "$address/v1/jobs?preset=fast" -o demo/job.json
job=$(grep -o '"id": *"job_[0-9a-f]*"' demo/job.json | head -1 | grep -o 'job_[0-9a-f]*')
# The stream ends by itself after the last event.
run curl -fsSN "$address/v1/jobs/$job/events" | tee demo/events.txt |
  grep --line-buffered -E '^event: job[.](queued|started|phase|succeeded|failed)' || true
grep -q '^event: job.succeeded' demo/events.txt ||
  { curl -sS "$address/v1/jobs/$job" >&2; echo "demo: the job did not succeed" >&2; exit 1; }
run curl -fsS "$address/v1/jobs/$job/mesh.ply" -o demo/uterus-mesh.ply
run curl -fsS "$address/v1/jobs/$job/report" -o demo/report.json
run curl -fsS "$address/v1/jobs/$job/metrics?format=csv" -o demo/metrics.csv
kill "$server" && wait "$server" || true

echo
echo "measured against the true surface:"
run "$meshway" evaluate demo/uterus-mesh.ply uterus
echo
echo "cloud:   demo/uterus.ply"
echo "mesh:    demo/uterus-mesh.ply   (open it with MeshLab, Blender, ParaView or 3D Slicer)"
echo "report:  demo/report.json"
echo "metrics: demo/metrics.csv"
echo
echo "look at it: $meshway serve --data-dir demo/data"
echo "            http://localhost:8080/#/jobs/$job"
