#!/usr/bin/env bash
# The example of `make demo`: a hand with a hole, as scanners leave it, from points to a closed mesh.
set -euo pipefail
cd "$(dirname "$0")/.."
meshway=target/release/meshway
mkdir -p demo

"$meshway" sample hand --points 3000 --interior 300 --missing 5 --seed 1 -o demo/hand.ply
"$meshway" reconstruct demo/hand.ply --preset fast \
  -o demo/hand-mesh.ply --report demo/report.json --metrics demo/metrics.csv
echo
echo "measured against the true surface:"
"$meshway" evaluate demo/hand-mesh.ply hand
echo
echo "cloud:   demo/hand.ply"
echo "mesh:    demo/hand-mesh.ply   (open it with MeshLab, Blender, ParaView or 3D Slicer)"
echo "report:  demo/report.json"
echo "metrics: demo/metrics.csv"
