#!/usr/bin/env bash
# The example of `make demo`: a uterus with a hole in its points, from cloud to closed mesh.
set -euo pipefail
cd "$(dirname "$0")/.."
meshway=target/release/meshway
mkdir -p demo

"$meshway" sample uterus --points 2000 --interior 100 --missing 10 --seed 3 -o demo/uterus.ply
"$meshway" reconstruct demo/uterus.ply --preset fast \
  -o demo/uterus-mesh.ply --report demo/report.json --metrics demo/metrics.csv
echo
echo "measured against the true surface:"
"$meshway" evaluate demo/uterus-mesh.ply uterus
echo
echo "cloud:   demo/uterus.ply"
echo "mesh:    demo/uterus-mesh.ply   (open it with MeshLab, Blender, ParaView or 3D Slicer)"
echo "report:  demo/report.json"
echo "metrics: demo/metrics.csv"
