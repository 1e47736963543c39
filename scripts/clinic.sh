#!/usr/bin/env bash
# Gives a job's files to the programs that clinics open them with: VTK (what 3D Slicer and ParaView
# read with), lib3mf, pydicom, nibabel, SimpleITK, dciodvfy, and an Orthanc that takes the DICOM file
# over its REST port and gives it back.
#
# MESHWAY: the program (target/release/meshway). The last two are Debian's dicom3tools and orthanc; one
# that is not installed is left out with a word, or with ALL=1 is a failure.
set -euo pipefail

version=3.0.2
root=$(cd "$(dirname "$0")/.." && pwd)
program=${MESHWAY:-$root/target/release/meshway}
package=pydicom
besides=(vtk==9.7.2 nibabel==5.4.2 simpleitk==2.5.7 lib3mf==2.5.0)

fail() { echo "clinic: $*" >&2; exit 1; }

. "$root/scripts/served.sh"

"$program" sample hand --points 1500 --output "$work/hand.ply" >/dev/null
"$tools/bin/python" "$root/scripts/clinic.py" "$address" "$work"

missing() {
  [ "${ALL:-}" != 1 ] || fail "$1 is not installed (Debian: apt-get install $2)"
  echo "$1: left out, it is not installed (Debian: apt-get install $2)"
}

if command -v dciodvfy >/dev/null; then
  for file in "$work"/*.dcm; do
    said=$(dciodvfy "$file" 2>&1) || fail "dciodvfy: $said"
    ! grep -i '^error' <<<"$said" || fail "dciodvfy: $said"
  done
  echo "dciodvfy: no error"
else
  missing dciodvfy dicom3tools
fi

if command -v Orthanc >/dev/null; then
  port=$("$tools/bin/python" -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
  cat > "$work/orthanc.json" <<JSON
{"StorageDirectory": "$work/orthanc", "IndexDirectory": "$work/orthanc", "HttpPort": $port, "Plugins": [],
 "RemoteAccessAllowed": false, "AuthenticationEnabled": false, "DicomServerEnabled": false}
JSON
  Orthanc "$work/orthanc.json" > "$work/orthanc.log" 2>&1 &
  besides_server=$!
  for _ in $(seq 100); do
    curl -fsS "http://127.0.0.1:$port/system" >/dev/null 2>&1 && break
    kill -0 "$besides_server" 2>/dev/null || { cat "$work/orthanc.log" >&2; fail "Orthanc did not start"; }
    sleep 0.1
  done
  for file in "$work"/*.dcm; do
    id=$(curl -fsS "http://127.0.0.1:$port/instances" --data-binary @"$file" \
      | "$tools/bin/python" -c 'import json, sys; a = json.load(sys.stdin); assert a["Status"] == "Success", a; print(a["ID"])')
    curl -fsS "http://127.0.0.1:$port/instances/$id/file" | cmp - "$file" || fail "Orthanc gave another file back"
    curl -fsS "http://127.0.0.1:$port/instances/$id/simplified-tags" | grep -q '"Modality" : "M3D"' \
      || fail "Orthanc does not know the modality"
  done
  kill "$besides_server"
  wait "$besides_server" 2>/dev/null || true
  besides_server=
  echo "Orthanc: took the files and gave them back, byte for byte"
else
  missing Orthanc orthanc
fi
