"""Clouds, jobs and events as the service tells them.

Each has the members most often used as attributes and the whole JSON as ``raw``, so that a client
need not be newer than its service.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Optional


@dataclass(frozen=True)
class Cloud:
    """A cloud that the service keeps."""

    id: str
    points: Optional[int]
    raw: dict[str, Any] = field(repr=False, compare=False)

    @classmethod
    def of(cls, raw: dict[str, Any]) -> Cloud:
        """From its JSON."""
        return cls(id=raw["id"], points=raw.get("points"), raw=raw)


@dataclass(frozen=True)
class Job:
    """A job. ``status`` is queued, running, succeeded, failed or cancelled; ``progress`` is 0 to 1."""

    id: str
    status: str
    progress: float
    cloud_id: str
    verdict: Optional[str]
    warnings: list[Any] = field(repr=False)
    error: Optional[dict[str, Any]]
    raw: dict[str, Any] = field(repr=False, compare=False)

    @classmethod
    def of(cls, raw: dict[str, Any]) -> Job:
        """From its JSON."""
        return cls(
            id=raw["id"],
            status=raw["status"],
            progress=raw["progress"],
            cloud_id=raw["cloud_id"],
            verdict=raw.get("verdict"),
            warnings=raw.get("warnings") or [],
            error=raw.get("error"),
            raw=raw,
        )

    @property
    def ended(self) -> bool:
        """Whether nothing more happens to it."""
        return self.status not in ("queued", "running")


@dataclass(frozen=True)
class Batch:
    """Jobs that were made together. ``status`` is queued, running or ended; ``progress`` is 0 to 1 and never
    goes back. ``jobs`` are their ids, in the order of clouds and parts."""

    id: str
    status: str
    progress: float
    counts: dict[str, int]
    jobs: list[str]
    raw: dict[str, Any] = field(repr=False, compare=False)

    @classmethod
    def of(cls, raw: dict[str, Any]) -> Batch:
        """From its JSON."""
        return cls(
            id=raw["id"],
            status=raw["status"],
            progress=raw["progress"],
            counts=raw["counts"],
            jobs=[job["id"] for job in raw.get("jobs", [])],
            raw=raw,
        )

    @property
    def ended(self) -> bool:
        """Whether nothing more happens to its jobs, however they ended."""
        return self.status == "ended"


@dataclass(frozen=True)
class Event:
    """Something that happened to a job: ``kind`` as in ``job.progress``. Ids of a job are 1, 2, 3, …; those of a
    batch grow, with gaps."""

    id: int
    kind: str
    data: dict[str, Any]

    @property
    def last(self) -> bool:
        """Whether no event of the job can follow."""
        return self.kind in ("job.succeeded", "job.failed", "job.cancelled")
