"""A service, or a machine of workers, for the benches of this folder: over the database of MESHWAY_TEST_DATABASE."""

import http.client
import os
import random
import re
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = os.environ.get("MESHWAY", ROOT / "target/release/meshway")


class Process:
    """One in a folder of its own."""

    def __init__(self, folder, command, *flags, program=PROGRAM):
        folder.mkdir(parents=True, exist_ok=True)
        self.log = folder / "log"
        database = os.environ["MESHWAY_TEST_DATABASE"]
        line = [program, command, f"--data-dir={folder}/data", f"--database={database}", *flags]
        self.process = subprocess.Popen(line, stderr=self.log.open("w"), stdout=subprocess.DEVNULL)

    def end(self):
        self.process.terminate()
        self.process.wait()


class Service(Process):
    """A service that answers."""

    def __init__(self, folder, *flags, program=PROGRAM):
        super().__init__(folder, "serve", "--listen=127.0.0.1:0", "--disk-reserve-mib=0", "--disk-reserve-percent=0",
                         *flags, program=program)
        for _ in range(200):
            found = re.search(r"http://(127[.]0[.]0[.]1:\d+)", self.log.read_text())
            if found:
                self.address = found[1]
                return
            time.sleep(0.1)
        sys.exit(self.log.read_text())

    def ask(self, method, path, body=None):
        """Milliseconds, and the body of the answer. A text that is sent is JSON."""
        client = http.client.HTTPConnection(self.address, timeout=120)
        begun = time.perf_counter()
        headers = {"Accept": "*/*"} | ({"Content-Type": "application/json"} if isinstance(body, str) else {})
        client.request(method, path, body, headers)
        answer = client.getresponse()
        data = answer.read()
        took = 1e3 * (time.perf_counter() - begun)
        if answer.status >= 300:
            sys.exit(f"{path}: {answer.status} {data[:500]}")
        return took, data


def sphere():
    """A small cloud, as text."""
    random.seed(1)
    lines = []
    for _ in range(300):
        point = [random.gauss(0, 1) for _ in range(3)]
        length = sum(x * x for x in point) ** 0.5
        lines.append(" ".join(f"{x / length:.6f}" for x in point))
    return "\n".join(lines).encode()
