"""The client for programs with threads."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, Optional, Union

import httpx

from . import steps
from .models import Batch, Cloud, Event, Job
from .points import arrays_of

if TYPE_CHECKING:
    from .points import Points

#: Tries after the first, of what may be tried again.
RETRIES = 6


def headers(key: Optional[str]) -> dict[str, str]:
    """What each request carries."""
    given = {"User-Agent": "meshway-client/0.1.0"}
    if key is not None:
        given["Authorization"] = f"Bearer {key}"
    return given


def id_of(item: Union[Job, Cloud, Batch, str]) -> str:
    """The id of a job, a cloud or a batch, or itself."""
    return item if isinstance(item, str) else item.id


class Meshway:
    """A Meshway service: its address, and a key where it wants one.

    ``verify`` is that of httpx: ``False``, or an ``ssl.SSLContext`` for a certificate authority of
    one's own and a certificate of the client. ``transport`` is a transport of httpx.
    """

    def __init__(
        self,
        url: str = "http://127.0.0.1:8080",
        key: Optional[str] = None,
        *,
        retries: int = RETRIES,
        timeout: float = 60.0,
        **http: Any,
    ) -> None:
        self._retries = retries
        self._http = httpx.Client(base_url=url, headers=headers(key), timeout=timeout, **http)

    def __enter__(self) -> Meshway:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def reconstruct(
        self,
        cloud: Union[Points, Cloud],
        *,
        preset: Optional[str] = None,
        settings: Optional[dict[str, Any]] = None,
        labels: Optional[dict[str, str]] = None,
        source: Optional[dict[str, Any]] = None,
        priority: Optional[int] = None,
        ttl: Optional[str] = None,
        assume_orientation: bool = False,
        timeout: Optional[float] = None,
    ) -> Mesh:
        """The mesh of a cloud: a path, bytes, a file, an array (n, 3) or (n, 6), or a cloud that is there.

        ``source`` chooses a part of a medical file, as in ``{"label": 5}``; ``assume_orientation`` takes one that
        does not say how it lies in the patient as it lies. ``ttl`` is how long the job is kept. After ``timeout`` seconds
        :class:`TimedOut` is raised, and the job goes on.
        """
        body = dict(preset=preset, settings=settings, labels=labels, source=source, priority=priority, ttl=ttl)
        given = steps.Given(body, assume_orientation)
        return Mesh(self, self._run(steps.reconstruct(cloud, given, timeout, self._retries)))

    def upload(
        self, cloud: Points, *, name: Optional[str] = None, assume_orientation: bool = False
    ) -> Cloud:
        """Sends a cloud. The ending of its name says what it is where its content leaves that open."""
        result: Cloud = self._run(steps.upload(cloud, name, assume_orientation, self._retries))
        return result

    def submit(
        self,
        cloud: Union[Points, Cloud],
        *,
        preset: Optional[str] = None,
        settings: Optional[dict[str, Any]] = None,
        labels: Optional[dict[str, str]] = None,
        source: Optional[dict[str, Any]] = None,
        priority: Optional[int] = None,
        ttl: Optional[str] = None,
        assume_orientation: bool = False,
    ) -> Job:
        """A new job, as :meth:`reconstruct` makes it, without waiting for it."""
        body = dict(preset=preset, settings=settings, labels=labels, source=source, priority=priority, ttl=ttl)
        given = steps.Given(body, assume_orientation)
        result: Job = self._run(steps.submit(cloud, given, self._retries))
        return result

    def batch(
        self,
        clouds: Iterable[Union[Points, Cloud]],
        *,
        preset: Optional[str] = None,
        settings: Optional[dict[str, Any]] = None,
        labels: Optional[dict[str, str]] = None,
        source: Union[str, dict[str, Any], list[dict[str, Any]], None] = None,
    ) -> Batch:
        """A job for each cloud, made together or not at all. With ``source``, as in ``"label:1,3"`` or
        ``"label:all"``, one for each part of each cloud."""
        body = {"preset": preset, "settings": settings, "labels": labels, "source": source}
        result: Batch = self._run(steps.batch(clouds, body, self._retries))
        return result

    def show_batch(self, batch: Union[Batch, str]) -> Batch:
        """Its present state."""
        result: Batch = self._run(steps.show_batch(id_of(batch), self._retries))
        return result

    def wait_batch(self, batch: Union[Batch, str], timeout: Optional[float] = None) -> Batch:
        """The batch once all its jobs have ended, however they did; else :class:`TimedOut`."""
        result: Batch = self._run(steps.wait_batch(id_of(batch), timeout, self._retries))
        return result

    def cancel_batch(self, batch: Union[Batch, str]) -> Batch:
        """Asks that all its jobs end."""
        result: Batch = self._run(steps.cancel_batch(id_of(batch), self._retries))
        return result

    def job(self, job: Union[Job, str]) -> Job:
        """Its present state."""
        result: Job = self._run(steps.show(id_of(job), self._retries))
        return result

    def jobs(self, **filters: str) -> Iterator[Job]:
        """All jobs, newest first; filters are those of the contract, as in ``status="failed"``."""
        return self._tell(steps.jobs(dict(filters), self._retries))

    def wait(self, job: Union[Job, str], timeout: Optional[float] = None) -> Job:
        """The job once it has succeeded; else :class:`JobFailed`, :class:`JobCancelled`, :class:`TimedOut`."""
        result: Job = self._run(steps.wait(id_of(job), timeout, self._retries))
        return result

    def watch(self, item: Union[Job, Batch, str], after: int = 0) -> Iterator[Event]:
        """The events of a job or a batch after one of them, as they come, to the last. A cut connection is resumed."""
        return self._tell(steps.watch(id_of(item), after, self._retries))

    def cancel(self, job: Union[Job, str]) -> Job:
        """Asks that the job end."""
        result: Job = self._run(steps.change(id_of(job), "cancel", self._retries))
        return result

    def retry(self, job: Union[Job, str]) -> Job:
        """A new job with the settings of this one."""
        result: Job = self._run(steps.change(id_of(job), "retry", self._retries))
        return result

    def delete(self, item: Union[Job, Cloud, Batch, str]) -> None:
        """Erases a job, a cloud, or a batch with its jobs and their clouds."""
        self._run(steps.erase(id_of(item), self._retries))

    def mesh(self, job: Union[Job, str]) -> Mesh:
        """The mesh of a job that has succeeded."""
        return Mesh(self, self.job(job))

    def _run(self, todo: steps.Steps) -> Any:
        drive = self._drive(todo)
        while True:
            try:
                next(drive)
            except StopIteration as end:
                return end.value

    def _tell(self, todo: steps.Steps) -> Iterator[Any]:
        yield from self._drive(todo)

    def _drive(self, todo: steps.Steps) -> Any:
        opened: Optional[httpx.Response] = None
        lines: Iterator[str] = iter(())
        try:
            effect = next(todo)
            while True:
                given: Any = None
                try:
                    if isinstance(effect, steps.Tell):
                        yield effect.item
                    elif isinstance(effect, steps.Pause):
                        time.sleep(effect.seconds)
                    elif isinstance(effect, steps.Line):
                        given = next(lines, None)
                    else:
                        if opened is not None:
                            opened.close()
                            opened = None
                        with effect.arguments() as arguments:
                            request = self._http.build_request(effect.method, effect.path, **arguments)
                            given = self._http.send(request, stream=effect.stream)
                        if effect.stream and given.is_success:
                            opened, lines = given, given.iter_lines()
                        elif effect.stream:
                            given.read()
                            given.close()
                except httpx.TransportError as broken:
                    effect = todo.throw(broken)
                else:
                    effect = todo.send(given)
        except StopIteration as end:
            return end.value
        finally:
            if opened is not None:
                opened.close()


class Mesh:
    """A mesh on the service, fetched when it is asked for."""

    def __init__(self, client: Meshway, job: Job) -> None:
        self._client = client
        self.job = job

    @property
    def verdict(self) -> Optional[str]:
        """How far it can be relied on: good, doubtful or poor."""
        return self.job.verdict

    def save(
        self,
        path: Union[str, os.PathLike[str]],
        *,
        space: Optional[str] = None,
        colors: Optional[str] = None,
    ) -> str:
        """Writes it in the format of the ending: ply, obj, stl, off, glb, 3mf, vtp, dcm, or nii.gz as a label
        map. ``space`` is lps, ras or source; ``colors="distance"`` colours ply and glb by the distance to the
        points. Gives the path."""
        todo = steps.save(self.job.id, path, steps.drawn(space, colors), self._client._retries)
        return str(self._client._run(todo))

    def content(
        self, format: str = "ply", *, space: Optional[str] = None, colors: Optional[str] = None
    ) -> bytes:
        """The bytes of the file in a format."""
        query = steps.drawn(space, colors)
        todo = steps.content(self.job.id, f"mesh.{format}", query, self._client._retries)
        return bytes(self._client._run(todo))

    def arrays(self, *, space: Optional[str] = None) -> tuple[Any, Any]:
        """NumPy arrays: vertices (n, 3) of float64 and triangles (m, 3) of int64."""
        return arrays_of(self.content("ply", space=space))

    def trimesh(self, *, space: Optional[str] = None) -> Any:
        """A ``trimesh.Trimesh``."""
        import trimesh

        vertices, faces = self.arrays(space=space)
        return trimesh.Trimesh(vertices, faces, process=False)

    def report(self) -> dict[str, Any]:
        """What is known of it."""
        return dict(self._client._run(steps.report(self.job.id, self._client._retries)))
