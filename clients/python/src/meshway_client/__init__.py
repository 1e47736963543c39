"""Client of Meshway: point clouds in, watertight meshes out.

    from meshway_client import Meshway
    Meshway("http://localhost:8080").reconstruct("scan.ply").save("mesh.stl")

:class:`AsyncMeshway` is the same for asyncio.
"""

from .asynchronous import AsyncMesh, AsyncMeshway
from .client import Mesh, Meshway
from .errors import JobCancelled, JobFailed, MeshwayError, TimedOut, Unreachable
from .models import Batch, Cloud, Event, Job

__all__ = [
    "AsyncMesh",
    "AsyncMeshway",
    "Batch",
    "Cloud",
    "Event",
    "Job",
    "JobCancelled",
    "JobFailed",
    "Mesh",
    "Meshway",
    "MeshwayError",
    "TimedOut",
    "Unreachable",
]
