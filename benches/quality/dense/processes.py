"""Runs programs and says what they cost.

Nothing large may be imported here or by whoever imports it: the peak memory that the system tells of a process begins
at that of the one which started it.
"""

import dataclasses
import os
import subprocess
import tempfile
import threading
import time


@dataclasses.dataclass
class Run:
    """A process from start to end; CPU seconds are those of all its threads, user and system."""

    code: int
    output: str
    errors: str
    seconds: float
    cpu_seconds: float
    memory_mb: float

    def costs(self):
        return {"seconds": self.seconds, "cpu_seconds": self.cpu_seconds, "memory_mb": self.memory_mb}

    def problem(self):
        last = self.errors.strip().splitlines()[-1:] or ["no message"]
        return f"killed by signal {-self.code}" if self.code < 0 else f"exit code {self.code}: {last[0]}"


def run(command, limit):
    """Runs `command` for `limit` seconds at most, then kills it."""
    with tempfile.TemporaryFile("w+") as output, tempfile.TemporaryFile("w+") as errors:
        started = time.monotonic()
        process = subprocess.Popen([str(part) for part in command], stdout=output, stderr=errors)
        clock = threading.Timer(limit, process.kill)
        clock.start()
        try:
            _, status, usage = os.wait4(process.pid, 0)
        except BaseException:
            process.kill()
            raise
        finally:
            clock.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        seconds = time.monotonic() - started
        for file in (output, errors):
            file.seek(0)
        return Run(
            process.returncode, output.read(), errors.read(), seconds, usage.ru_utime + usage.ru_stime,
            usage.ru_maxrss * 1024e-6,
        )
