"""A whole flow with the client that scripts/client.sh generates: client.py ADDRESS CLOUD."""

import io
import sys
import time

from meshway_client import Client
from meshway_client.api.clouds import create_cloud, delete_cloud, get_cloud_content, list_clouds
from meshway_client.api.jobs import create_job, delete_job, get_job, list_jobs
from meshway_client.api.results import evaluate_field, get_mesh_as, get_model, get_report
from meshway_client.api.system import get_limits, get_presets, get_version
from meshway_client.api.training import get_metrics
from meshway_client.models import (
    CreateJobFilesBody,
    FieldRequest,
    GetMetricsFieldsItem,
    MeshFormat,
    NewJob,
    PresetName,
    Problem,
    Settings,
    Status,
)
from meshway_client.types import File

address, path = sys.argv[1:]
client = Client(base_url=address)
with open(path, "rb") as file:
    content = file.read()


def cloud_file():
    return File(payload=io.BytesIO(content), file_name="sphere.ply", mime_type="application/octet-stream")


def ended(id):
    for _ in range(600):
        job = get_job.sync(id, client=client)
        if job.status not in (Status.QUEUED, Status.RUNNING):
            return job
        time.sleep(0.1)
    raise AssertionError("the job does not end")


cloud = create_cloud.sync(client=client, body=cloud_file())
assert cloud.points == 500, cloud
assert get_cloud_content.sync(cloud.id, client=client).payload.read() == content
assert [item.id for item in list_clouds.sync(client=client).items] == [cloud.id]

settings = Settings.from_dict({"training": {"max_evaluations": 20}, "surface": {"resolution": 24}})
asked = NewJob(cloud_id=cloud.id, preset=PresetName.FAST, settings=settings)
first = create_job.sync(client=client, body=asked)
form = CreateJobFilesBody(file=cloud_file(), job=NewJob(preset=PresetName.FAST, settings=settings))
second = create_job.sync(client=client, body=form)
raw = create_job.sync(client=client, body=cloud_file(), dry_run=True, preset=PresetName.FAST)
assert raw.dry_run is True, raw
for job in (first, second):
    job = ended(job.id)
    assert job.status == Status.SUCCEEDED, job
    assert job.mesh.closed and job.mesh.triangles > 100, job.mesh
assert len(list_jobs.sync(client=client, status=Status.SUCCEEDED).items) == 2

begins = {"ply": b"ply", "obj": b"v ", "stl": b"Meshway", "off": b"OFF", "glb": b"glTF",
          "3mf": b"PK", "vtp": b"<?xml"}
for format_ in MeshFormat:
    mesh = get_mesh_as.sync(first.id, format_, client=client)
    if format_.value == "dcm":
        # The sphere has no frame, which DICOM needs.
        assert isinstance(mesh, Problem) and mesh.code == "not_acceptable", mesh
        continue
    begin = begins[format_.value]
    assert mesh.payload.read().lstrip(b"#").lstrip().startswith(begin) or format_ == MeshFormat.OBJ, format_
assert len(get_model.sync(first.id, client=client).payload.read()) > 1000
report = get_report.sync(first.id, client=client)
assert report.mesh["closed"] if isinstance(report.mesh, dict) else report.mesh.closed, report
fields = [GetMetricsFieldsItem.LOSS, GetMetricsFieldsItem.VALIDATION_LOSS]
series = get_metrics.sync(first.id, client=client, fields=fields)
assert series is not None
values = evaluate_field.sync(first.id, client=client, body=FieldRequest(points=[[0.0, 0.0, 0.0]]))
assert len(values.values) == 1, values
for system in (get_limits, get_presets, get_version):
    assert not isinstance(system.sync(client=client), (Problem, type(None))), system

assert isinstance(delete_cloud.sync(cloud.id, client=client), (Problem, type(None)))
for job in (first, second):
    assert delete_job.sync_detailed(job.id, client=client).status_code == 204
gone = get_job.sync(first.id, client=client)
assert isinstance(gone, Problem) and gone.code == "gone", gone
print("the generated client: uploads, jobs, meshes, series, field, erasure")
