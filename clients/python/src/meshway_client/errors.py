"""What can go wrong, as exceptions with a stable code."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Optional

import httpx

if TYPE_CHECKING:
    from .models import Job


class MeshwayError(Exception):
    """A problem that the service told.

    ``code`` is stable; the list of all codes is in the contract. ``retryable`` says whether the same
    request can succeed later. ``errors`` names each place at fault, ``members`` is the whole document.
    """

    def __init__(
        self,
        code: str,
        detail: str,
        *,
        status: Optional[int] = None,
        retryable: bool = False,
        members: Optional[dict[str, Any]] = None,
    ) -> None:
        super().__init__(f"{code}: {detail}")
        self.code = code
        self.detail = detail
        self.status = status
        self.retryable = retryable
        self.members = members or {}
        self.errors: list[dict[str, Any]] = list(self.members.get("errors") or [])
        self.request_id: Optional[str] = self.members.get("request_id")


class Unreachable(MeshwayError):
    """No answer came, or half of one: code ``unreachable``."""

    def __init__(self, error: Exception) -> None:
        super().__init__("unreachable", str(error) or type(error).__name__, retryable=True)


class TimedOut(MeshwayError):
    """The job did not end within the timeout of a wait, and goes on: code ``timed_out``."""

    def __init__(self, job_id: str, seconds: float) -> None:
        detail = f"{job_id} has not ended within {seconds:g} seconds, and goes on"
        super().__init__("timed_out", detail, retryable=True)
        self.job_id = job_id


class JobFailed(MeshwayError):
    """The job ended without a mesh; ``job`` is its last state."""

    def __init__(self, job: Job) -> None:
        problem = job.error or {}
        super().__init__(
            str(problem.get("code", "job_failed")),
            str(problem.get("detail", f"{job.id} failed")),
            status=problem.get("status"),
            retryable=bool(problem.get("retryable", False)),
            members=problem,
        )
        self.job = job


class JobCancelled(MeshwayError):
    """Somebody cancelled the job: code ``job_cancelled``."""

    def __init__(self, job: Job) -> None:
        super().__init__("job_cancelled", f"{job.id} was cancelled")
        self.job = job


def problem_of(response: httpx.Response) -> MeshwayError:
    """The exception for an answer that is no success."""
    try:
        members = response.json()
    except ValueError:
        members = None
    if not isinstance(members, dict) or "code" not in members:
        # A proxy spoke, not the service.
        return MeshwayError(
            f"http_{response.status_code}",
            f"the answer is no problem document of Meshway: {response.text[:200]!r}",
            status=response.status_code,
            retryable=response.status_code in (429, 502, 503, 504),
        )
    return MeshwayError(
        str(members["code"]),
        str(members.get("detail", "")),
        status=response.status_code,
        retryable=bool(members.get("retryable", False)),
        members=members,
    )
