"""What the client does, without doing it: generators that yield what is to be sent or awaited.

One driver sends with threads, another with asyncio; what is decided is here once.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import tempfile
import time
import uuid
from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Optional, Union

import httpx

from .errors import JobCancelled, JobFailed, MeshwayError, TimedOut, Unreachable, problem_of
from .models import Batch, Cloud, Event, Job
from .points import Source, source_of

#: Seconds without a byte of an event stream; the service sends a comment every 15.
SILENCE = 45.0
#: Longest pause before a further try, in seconds.
LONGEST_PAUSE = 30.0
#: Bytes above which a file is sent in parts that go on where a connection broke.
LARGE = 32 << 20
#: Bytes of such a part.
PART = 8 << 20
FORMATS = ("ply", "obj", "stl", "off", "glb", "3mf", "vtp", "dcm")


@dataclass
class Ask:
    """A request. With ``stream`` only the head of the answer is awaited."""

    method: str
    path: str
    params: dict[str, Any] = field(default_factory=dict)
    headers: dict[str, str] = field(default_factory=dict)
    json: Any = None
    file: Optional[Source] = None
    content: Optional[bytes] = None
    stream: bool = False
    timeout: Optional[float] = None

    @contextlib.contextmanager
    def arguments(self) -> Iterator[dict[str, Any]]:
        """Those of httpx, with the file open."""
        given: dict[str, Any] = {"params": self.params, "headers": self.headers}
        if self.json is not None:
            given["json"] = self.json
        if self.content is not None:
            given["content"] = self.content
        if self.timeout is not None:
            given["timeout"] = httpx.Timeout(30.0, read=self.timeout)
        with contextlib.ExitStack() as stack:
            if self.file is not None:
                content = self.file.open()
                if not isinstance(content, bytes):
                    stack.enter_context(content)
                given["files"] = {"file": (self.file.name, content, "application/octet-stream")}
            yield given


@dataclass
class Pause:
    """Seconds in which nothing is done."""

    seconds: float


@dataclass
class Line:
    """The next line of the open stream; its answer is ``None`` at the end."""


@dataclass
class Tell:
    """Something for the caller of an iteration."""

    item: Any


Effect = Union[Ask, Pause, Line, Tell]
Steps = Generator[Effect, Any, Any]


def pause_before(attempt: int, answer: Optional[httpx.Response] = None) -> Pause:
    """What the service asks for, or twice as long each time, not all clients at once."""
    told = answer.headers.get("retry-after", "") if answer is not None else ""
    if told.isdigit():
        return Pause(min(float(told), LONGEST_PAUSE))
    return Pause(min(0.25 * 2.0**attempt, LONGEST_PAUSE) * random.uniform(0.5, 1.0))


def ask(request: Ask, retries: int) -> Steps:
    """The answer to a request that may be sent again: a POST carries its idempotency key."""
    if request.method == "POST":
        request.headers.setdefault("Idempotency-Key", str(uuid.uuid4()))
    attempt = 0
    while True:
        answer = None
        try:
            answer = yield request
            if answer.is_success:
                return answer
            error = problem_of(answer)
        except httpx.TransportError as broken:
            error = Unreachable(broken)
        if request.method == "DELETE" and attempt > 0 and error.status in (404, 410):
            # An earlier try did it; its answer was lost.
            return answer
        if not error.retryable or attempt >= retries:
            raise error
        yield pause_before(attempt, answer)
        attempt += 1


def upload(cloud: Any, name: Optional[str], assume_orientation: bool, retries: int) -> Steps:
    """Sends a cloud."""
    params = {"assume_orientation": "true"} if assume_orientation else {}
    source = source_of(cloud, name)
    if source.length() > LARGE:
        answer = yield from in_parts(source, params, retries)
    else:
        answer = yield from ask(Ask("POST", "v1/clouds", params=params, file=source), retries)
    return Cloud.of(answer.json())


def in_parts(source: Source, params: dict[str, Any], retries: int) -> Steps:
    """The answer to the last part of a large file. A part that was cut goes on behind what came of it."""
    length = source.length()
    told = {"Upload-Complete": "?0", "Upload-Length": str(length)}
    if source.ending():
        told["Content-Disposition"] = f'inline; filename="cloud.{source.ending()}"'
    begun = yield from ask(Ask("POST", "v1/uploads", params=params, headers=told), retries)
    path = "v1/uploads/" + begun.headers["location"].rpartition("/")[2]
    at = attempt = 0
    while True:
        part = source.part(at, PART)
        last = at + len(part) >= length
        told = {
            "Upload-Offset": str(at),
            "Upload-Complete": "?1" if last else "?0",
            "Content-Type": "application/partial-upload",
        }
        answer = None
        try:
            answer = yield Ask("PATCH", path, headers=told, content=part)
            if answer.is_success and last:
                return answer
            if answer.is_success:
                at, attempt = at + len(part), 0
                continue
            error = problem_of(answer)
        except httpx.TransportError as broken:
            error = Unreachable(broken)
        if not error.retryable or attempt >= retries:
            raise error
        yield pause_before(attempt, answer)
        attempt += 1
        where = yield from ask(Ask("HEAD", path), retries)
        at = int(where.headers["upload-offset"])


def there(cloud: Any, assume_orientation: bool, retries: int) -> Steps:
    """The id of a cloud, which is sent first where it is not there yet."""
    if not isinstance(cloud, Cloud) and not (isinstance(cloud, str) and cloud.startswith("cld_")):
        cloud = yield from upload(cloud, None, assume_orientation, retries)
    return cloud.id if isinstance(cloud, Cloud) else cloud


@dataclass
class Given:
    """What a job is asked for: members of the request, ``None`` where they are left out, and how its cloud is read."""

    body: dict[str, Any]
    assume_orientation: bool = False


def submit(cloud: Any, given: Given, retries: int) -> Steps:
    """A job for a cloud."""
    cloud_id = yield from there(cloud, given.assume_orientation, retries)
    body = {name: value for name, value in given.body.items() if value is not None}
    answer = yield from ask(Ask("POST", "v1/jobs", json={"cloud_id": cloud_id, **body}), retries)
    return Job.of(answer.json())


def batch(clouds: Iterable[Any], body: dict[str, Any], retries: int) -> Steps:
    """A job for each of the clouds, or for each of their parts: all of them or none."""
    ids = []
    for cloud in clouds:
        ids.append((yield from there(cloud, False, retries)))
    given = {name: value for name, value in body.items() if value is not None}
    answer = yield from ask(Ask("POST", "v1/batches", json={"clouds": ids, **given}), retries)
    return Batch.of(answer.json())


def show_batch(batch_id: str, retries: int) -> Steps:
    """The present state of a batch."""
    answer = yield from ask(Ask("GET", f"v1/batches/{batch_id}"), retries)
    return Batch.of(answer.json())


def cancel_batch(batch_id: str, retries: int) -> Steps:
    """Cancels all jobs of a batch."""
    answer = yield from ask(Ask("POST", f"v1/batches/{batch_id}/cancel"), retries)
    return Batch.of(answer.json())


def wait_batch(batch_id: str, timeout: Optional[float], retries: int) -> Steps:
    """The batch once all its jobs have ended, however they did."""
    yield from silently(watch(batch_id, 0, retries, None if timeout is None else time.monotonic() + timeout))
    found: Batch = yield from show_batch(batch_id, retries)
    if not found.ended:
        raise TimedOut(batch_id, timeout or 0.0)
    return found


def show(job_id: str, retries: int) -> Steps:
    """The present state of a job."""
    answer = yield from ask(Ask("GET", f"v1/jobs/{job_id}"), retries)
    return Job.of(answer.json())


def change(job_id: str, act: str, retries: int) -> Steps:
    """Cancels a job, or has it done once more."""
    body: Optional[dict[str, Any]] = {} if act == "retry" else None
    answer = yield from ask(Ask("POST", f"v1/jobs/{job_id}/{act}", json=body), retries)
    return Job.of(answer.json())


def erase(item_id: str, retries: int) -> Steps:
    """Erases a job, a cloud, or a batch with its jobs and clouds."""
    yield from ask(Ask("DELETE", path_of(item_id)), retries)


def path_of(item_id: str) -> str:
    """Where an item is, as the beginning of its id says."""
    kind = {"cld_": "clouds", "bat_": "batches"}.get(item_id[:4], "jobs")
    return f"v1/{kind}/{item_id}"


def jobs(filters: dict[str, Any], retries: int) -> Steps:
    """Tells all jobs, newest first."""
    params = dict(filters)
    while True:
        page = (yield from ask(Ask("GET", "v1/jobs", params=params), retries)).json()
        for item in page["items"]:
            yield Tell(Job.of(item))
        if not page.get("next_cursor"):
            return
        params["cursor"] = page["next_cursor"]


def watch(item_id: str, after: int, retries: int, until: Optional[float] = None) -> Steps:
    """Tells the events of a job or a batch to the last; a cut connection is opened again where it was cut."""
    attempt = 0
    is_batch = item_id.startswith("bat_")
    while True:
        left = SILENCE if until is None else until - time.monotonic()
        if left <= 0:
            return
        headers = {"Accept": "text/event-stream", "Last-Event-ID": str(after)}
        request = Ask("GET", f"{path_of(item_id)}/events", headers=headers, stream=True, timeout=min(left, SILENCE))
        answer = None
        try:
            answer = yield request
            if answer.status_code == 204:
                return
            if not answer.is_success:
                raise problem_of(answer)
            parser = Parser()
            while (line := (yield Line())) is not None:
                attempt = 0
                event = parser.feed(line)
                if until is not None and time.monotonic() >= until:
                    return
                if event is None:
                    continue
                after = event.id
                if event.kind != "reset":
                    yield Tell(event)
                if event.last and not is_batch:
                    return
            if is_batch and attempt == 0:
                # The stream of a batch closes after its last event: then there is none after it.
                yield Pause(0.1)
                continue
            error: MeshwayError = Unreachable(httpx.ReadError("the stream ended before the job"))
        except httpx.TransportError as broken:
            error = Unreachable(broken)
        except MeshwayError as refused:
            error = refused
        if until is not None and time.monotonic() >= until:
            return
        if not error.retryable or attempt >= retries:
            raise error
        yield pause_before(attempt, answer)
        attempt += 1


class Parser:
    """Lines of server-sent events, put together."""

    def __init__(self) -> None:
        self.fields: dict[str, str] = {}

    def feed(self, line: str) -> Optional[Event]:
        """The event that ends with this line, if one does."""
        if line:
            name, _, value = line.partition(":")
            value = value[1:] if value.startswith(" ") else value
            if name == "data" and name in self.fields:
                value = f"{self.fields[name]}\n{value}"
            self.fields[name] = value
            return None
        fields, self.fields = self.fields, {}
        if "data" not in fields or not fields.get("id", "").isdigit():
            return None
        return Event(int(fields["id"]), fields.get("event", "message"), json.loads(fields["data"]))


def silently(told: Steps) -> Steps:
    """Follows events for the clock only."""
    try:
        effect = next(told)
        while True:
            try:
                given = None if isinstance(effect, Tell) else (yield effect)
            except httpx.TransportError as broken:
                effect = told.throw(broken)
            else:
                effect = told.send(given)
    except StopIteration:
        pass


def wait(job_id: str, timeout: Optional[float], retries: int) -> Steps:
    """The job once it has succeeded."""
    until = None if timeout is None else time.monotonic() + timeout
    yield from silently(watch(job_id, 0, retries, until))
    job: Job = yield from show(job_id, retries)
    if job.status == "succeeded":
        return job
    if job.status == "cancelled":
        raise JobCancelled(job)
    if job.status == "failed":
        raise JobFailed(job)
    raise TimedOut(job_id, timeout or 0.0)


def reconstruct(cloud: Any, given: Given, timeout: Optional[float], retries: int) -> Steps:
    """The job of a cloud, once it has succeeded."""
    job: Job = yield from submit(cloud, given, retries)
    return (yield from wait(job.id, timeout, retries))


def report(job_id: str, retries: int) -> Steps:
    """The report of a job."""
    return (yield from ask(Ask("GET", f"v1/jobs/{job_id}/report"), retries)).json()


def drawn(space: Optional[str], colors: Optional[str]) -> dict[str, str]:
    """How a mesh is written: in which coordinates, and with what colours."""
    asked = {"space": space, "colors": colors}
    return {name: value for name, value in asked.items() if value is not None}


def content(job_id: str, name: str, query: dict[str, str], retries: int) -> Steps:
    """The bytes of a file of a job, such as mesh.stl."""
    answer = yield from ask(Ask("GET", f"v1/jobs/{job_id}/{name}", params=query), retries)
    return answer.content


def save(job_id: str, path: Union[str, os.PathLike[str]], query: dict[str, str], retries: int) -> Steps:
    """Writes a file, all of it or nothing; its ending names the format."""
    path = os.fspath(path)
    data = yield from content(job_id, file_name(path), query, retries)
    descriptor, part = tempfile.mkstemp(dir=os.path.dirname(path) or ".", prefix=".meshway-")
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(part, 0o666 & ~umask)
        os.replace(part, path)
    except BaseException:
        os.unlink(part)
        raise
    return path


def file_name(path: str) -> str:
    """What the service calls the file that a path asks for."""
    if path.lower().endswith(".nii.gz"):
        return "mask.nii.gz"
    ending = os.path.splitext(path)[1].lower().lstrip(".")
    if ending not in FORMATS:
        raise ValueError(f"{path}: a mesh ends in {', '.join(FORMATS)}, and its label map in nii.gz")
    return f"mesh.{ending}"
