"""The client for asyncio: that of client.py with ``await``."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Iterable
from typing import TYPE_CHECKING, Any, Optional, Union

import httpx

from . import steps
from .client import RETRIES, headers, id_of
from .models import Batch, Cloud, Event, Job
from .points import arrays_of

if TYPE_CHECKING:
    from .points import Points

class AsyncMeshway:
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
        self._http = httpx.AsyncClient(base_url=url, headers=headers(key), timeout=timeout, **http)

    async def __aenter__(self) -> AsyncMeshway:
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Closes the connections."""
        await self._http.aclose()

    async def reconstruct(
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
    ) -> AsyncMesh:
        """The mesh of a cloud: a path, bytes, a file, an array (n, 3) or (n, 6), or a cloud that is there.

        ``source`` chooses a part of a medical file, as in ``{"label": 5}``; ``assume_orientation`` takes one that
        does not say how it lies in the patient as it lies. ``ttl`` is how long the job is kept. After ``timeout`` seconds
        :class:`TimedOut` is raised, and the job goes on.
        """
        body = dict(preset=preset, settings=settings, labels=labels, source=source, priority=priority, ttl=ttl)
        given = steps.Given(body, assume_orientation)
        return AsyncMesh(self, await self._run(steps.reconstruct(cloud, given, timeout, self._retries)))

    async def upload(
        self, cloud: Points, *, name: Optional[str] = None, assume_orientation: bool = False
    ) -> Cloud:
        """Sends a cloud. The ending of its name says what it is where its content leaves that open."""
        result: Cloud = await self._run(steps.upload(cloud, name, assume_orientation, self._retries))
        return result

    async def submit(
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
        result: Job = await self._run(steps.submit(cloud, given, self._retries))
        return result

    async def batch(
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
        result: Batch = await self._run(steps.batch(clouds, body, self._retries))
        return result

    async def show_batch(self, batch: Union[Batch, str]) -> Batch:
        """Its present state."""
        result: Batch = await self._run(steps.show_batch(id_of(batch), self._retries))
        return result

    async def wait_batch(self, batch: Union[Batch, str], timeout: Optional[float] = None) -> Batch:
        """The batch once all its jobs have ended, however they did; else :class:`TimedOut`."""
        result: Batch = await self._run(steps.wait_batch(id_of(batch), timeout, self._retries))
        return result

    async def cancel_batch(self, batch: Union[Batch, str]) -> Batch:
        """Asks that all its jobs end."""
        result: Batch = await self._run(steps.cancel_batch(id_of(batch), self._retries))
        return result

    async def job(self, job: Union[Job, str]) -> Job:
        """Its present state."""
        result: Job = await self._run(steps.show(id_of(job), self._retries))
        return result

    def jobs(self, **filters: str) -> AsyncIterator[Job]:
        """All jobs, newest first; filters are those of the contract, as in ``status="failed"``."""
        return self._tell(steps.jobs(dict(filters), self._retries))

    async def wait(self, job: Union[Job, str], timeout: Optional[float] = None) -> Job:
        """The job once it has succeeded; else :class:`JobFailed`, :class:`JobCancelled`, :class:`TimedOut`."""
        result: Job = await self._run(steps.wait(id_of(job), timeout, self._retries))
        return result

    def watch(self, item: Union[Job, Batch, str], after: int = 0) -> AsyncIterator[Event]:
        """The events of a job or a batch after one of them, as they come, to the last. A cut connection is resumed."""
        return self._tell(steps.watch(id_of(item), after, self._retries))

    async def cancel(self, job: Union[Job, str]) -> Job:
        """Asks that the job end."""
        result: Job = await self._run(steps.change(id_of(job), "cancel", self._retries))
        return result

    async def retry(self, job: Union[Job, str]) -> Job:
        """A new job with the settings of this one."""
        result: Job = await self._run(steps.change(id_of(job), "retry", self._retries))
        return result

    async def delete(self, item: Union[Job, Cloud, Batch, str]) -> None:
        """Erases a job, a cloud, or a batch with its jobs and their clouds."""
        await self._run(steps.erase(id_of(item), self._retries))

    async def mesh(self, job: Union[Job, str]) -> AsyncMesh:
        """The mesh of a job that has succeeded."""
        return AsyncMesh(self, await self.job(job))

    async def _run(self, todo: steps.Steps) -> Any:
        drive = _Drive(self._http, todo)
        try:
            while isinstance(await drive.next(), steps.Tell):
                pass
            return drive.value
        finally:
            await drive.close()

    async def _tell(self, todo: steps.Steps) -> AsyncIterator[Any]:
        drive = _Drive(self._http, todo)
        try:
            while isinstance(told := await drive.next(), steps.Tell):
                yield told.item
        finally:
            await drive.close()


class _Drive:
    """Does the steps, up to the next item that they tell."""

    def __init__(self, http: httpx.AsyncClient, todo: steps.Steps) -> None:
        self.value: Any = None
        self._http = http
        self._todo = todo
        self._opened: Optional[httpx.Response] = None
        self._lines: Optional[AsyncIterator[str]] = None

    async def next(self) -> Optional[steps.Tell]:
        given: Any = None
        broken: Optional[Exception] = None
        while True:
            try:
                effect = self._todo.send(given) if broken is None else self._todo.throw(broken)
            except StopIteration as end:
                self.value = end.value
                return None
            given, broken = None, None
            if isinstance(effect, steps.Tell):
                return effect
            try:
                given = await self._perform(effect)
            except httpx.TransportError as error:
                broken = error

    async def _perform(self, effect: steps.Effect) -> Any:
        if isinstance(effect, steps.Pause):
            await asyncio.sleep(effect.seconds)
            return None
        if isinstance(effect, steps.Line):
            try:
                return None if self._lines is None else await self._lines.__anext__()
            except StopAsyncIteration:
                return None
        assert isinstance(effect, steps.Ask)
        await self.close()
        with effect.arguments() as arguments:
            request = self._http.build_request(effect.method, effect.path, **arguments)
            answer = await self._http.send(request, stream=effect.stream)
        if effect.stream and answer.is_success:
            self._opened, self._lines = answer, answer.aiter_lines()
        elif effect.stream:
            await answer.aread()
            await answer.aclose()
        return answer

    async def close(self) -> None:
        opened, self._opened = self._opened, None
        if opened is not None:
            await opened.aclose()


class AsyncMesh:
    """A mesh on the service, fetched when it is asked for."""

    def __init__(self, client: AsyncMeshway, job: Job) -> None:
        self._client = client
        self.job = job

    @property
    def verdict(self) -> Optional[str]:
        """How far it can be relied on: good, doubtful or poor."""
        return self.job.verdict

    async def save(
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
        return str(await self._client._run(todo))

    async def content(
        self, format: str = "ply", *, space: Optional[str] = None, colors: Optional[str] = None
    ) -> bytes:
        """The bytes of the file in a format."""
        query = steps.drawn(space, colors)
        todo = steps.content(self.job.id, f"mesh.{format}", query, self._client._retries)
        return bytes(await self._client._run(todo))

    async def arrays(self, *, space: Optional[str] = None) -> tuple[Any, Any]:
        """NumPy arrays: vertices (n, 3) of float64 and triangles (m, 3) of int64."""
        return arrays_of(await self.content("ply", space=space))

    async def trimesh(self, *, space: Optional[str] = None) -> Any:
        """A ``trimesh.Trimesh``."""
        import trimesh

        vertices, faces = await self.arrays(space=space)
        return trimesh.Trimesh(vertices, faces, process=False)

    async def report(self) -> dict[str, Any]:
        """What is known of it."""
        return dict(await self._client._run(steps.report(self.job.id, self._client._retries)))
