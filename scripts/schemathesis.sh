#!/usr/bin/env bash
# Makes requests up from openapi.yaml and sends them to a served instance, good ones and bad ones;
# fails on an answer that the contract does not allow and on every 5xx.
#
# MESHWAY: the program (target/release/meshway). EXAMPLES: requests for each operation (20). Further
# arguments go to Schemathesis, such as --include-path /v1/jobs.
set -euo pipefail

version=4.32.5
root=$(cd "$(dirname "$0")/.." && pwd)
program=${MESHWAY:-$root/target/release/meshway}
examples=${EXAMPLES:-20}
package=schemathesis
# With a key: what the contract asks for is asked for.
scopes=read,write,delete,audit,admin

fail() { echo "contract: $*" >&2; exit 1; }

. "$root/scripts/served.sh"

# A job to ask about: made-up ids only ever meet 404.
"$program" sample sphere --points 500 --output "$work/sphere.ply" >/dev/null
job=$("$tools/bin/python" - "$address" "$work/sphere.ply" "$key" <<'PYTHON'
import json, sys, urllib.request

address, path, key = sys.argv[1:]
settings = json.dumps({"preset": "fast", "settings": {
    "training": {"max_evaluations": 20, "snapshot_evaluations": [10], "histogram_evaluations": [5]},
    "surface": {"resolution": 24}}})
form = (b"--x\r\nContent-Disposition: form-data; name=\"job\"\r\n\r\n" + settings.encode()
        + b"\r\n--x\r\nContent-Disposition: form-data; name=\"file\"; filename=\"sphere.ply\"\r\n\r\n"
        + open(path, "rb").read().replace(b"element vertex", b"comment SPACE=LPS\nelement vertex", 1) + b"\r\n--x--\r\n")
request = urllib.request.Request(address + "/v1/jobs", form, {
    "Content-Type": "multipart/form-data; boundary=x", "Prefer": "wait=60", "Authorization": "Bearer " + key})
job = json.load(urllib.request.urlopen(request))
assert job["status"] == "succeeded", job
print(job["id"], job["cloud_id"])
PYTHON
)
read -r job cloud <<<"$job"

cat > "$work/schemathesis.toml" <<TOML
# Ids that exist, beside made-up ones.
[parameters]
"path.file" = "10.ply"

[checks.positive_data_acceptance]
expected-statuses = ["2xx", "304", "404", "409", "410", "416"]

# A job that was erased meanwhile says so, whatever else is wrong with a request.
[checks.negative_data_rejection]
expected-statuses = ["4xx"]

# What fits the schema and is refused all the same: made-up bytes are no cloud (415, 422), settings
# contradict each other or the cloud (422), a cursor is none of ours (400), an address is not for webhooks (422).
[[operations]]
include-path-regex = "^/v1/(audit|batches|clouds|jobs|keys|webhooks|jobs/[{]id[}]/retry|webhooks/[{]id[}](/deliveries)?)$"
[operations.checks.positive_data_acceptance]
expected-statuses = ["2xx", "304", "400", "404", "409", "410", "413", "415", "422"]

# Headers of two protocols, which are refused together and each without the other's.
[[operations]]
include-path-regex = "^/v1/uploads"
[operations.checks.positive_data_acceptance]
expected-statuses = ["2xx", "304", "400", "404", "409", "410", "412", "413", "415", "422"]

[[operations]]
include-path-regex = "^/v1/jobs/[{]id[}]/(events|gradients|mask|report|model|field)"
parameters = { "path.id" = "$job" }

# Curves of blocks take no other parameter.
[[operations]]
include-path-regex = "^/v1/jobs/[{]id[}]/metrics"
parameters = { "path.id" = "$job" }
[operations.checks.positive_data_acceptance]
expected-statuses = ["2xx", "304", "404", "409", "410", "416", "422"]

# A member that is null is taken as one that is left out.
[[operations]]
include-path-regex = "^/v1/(keys|jobs|batches|clouds|webhooks|jobs/[{]id[}]|clouds/[{]id[}]|webhooks/[{]id[}]|jobs/[{]id[}]/(field|retry))$"
[operations.checks.negative_data_rejection]
expected-statuses = ["2xx", "4xx"]

# DICOM is in LPS, whatever is asked for.
[[operations]]
include-path-regex = "^/v1/jobs/[{]id[}]/(mesh|snapshots)"
parameters = { "path.id" = "$job" }
[operations.checks.positive_data_acceptance]
expected-statuses = ["2xx", "304", "404", "409", "410", "416", "422"]

[[operations]]
include-path-regex = "^/v1/clouds/[{]id[}]/(content|points)"
parameters = { "path.id" = "$cloud" }
TOML
cat > "$work/raw_bytes.py" <<PYTHON
"""The media types of bytes that belong to an upload."""
import schemathesis


@schemathesis.serializer("application/offset+octet-stream", "application/partial-upload")
def raw(context, value):
    return value if isinstance(value, bytes) else str(value).encode()
PYTHON
export PYTHONPATH="$work" SCHEMATHESIS_HOOKS=raw_bytes
# Left to our own tests: event streams end with their job or the service, so the one over all jobs; the beginning of
# an upload, whose answer 201 has a cloud where all bytes came and nothing where more are to come.
"$tools/bin/schemathesis" --config-file "$work/schemathesis.toml" run "$root/openapi.yaml" \
  --url "$address" --header "Authorization: Bearer $key" --checks all --max-examples "$examples" --seed 1 --request-timeout 30 \
  --exclude-path /v1/events --exclude-path /v1/uploads \
  --suppress-health-check all --no-color "$@" || {
    status=$?
    grep -E 'ERROR|panicked' "$work/log" | tail -20 >&2 || true
    exit "$status"
  }
curl -fsS "$address/livez" >/dev/null || fail "the service is gone"
