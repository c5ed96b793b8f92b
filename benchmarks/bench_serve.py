"""`symgrasp serve` over 1,000 posts from 8 clients: latency, throughput, memory.

The networks are off, since the bench `api` measures them: depth, planar grasps and HTTP remain.
"""

import json
import subprocess
import sys
import time
import urllib.request
from base64 import b64encode
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import psutil

from benchmarks.timing import Measurement
from pipelines.inference.models import WEIGHTS

POSTS, CLIENTS, PORT = 1000, 8, 18766
WARM = 100  # posts before the first reading of memory
URL = f"http://127.0.0.1:{PORT}"
LIGHT = ("--set", "regions=geometric", "--set", "method=planar")


def measure() -> list[Measurement]:
    """Return latency and memory of a server that is started for the measurement."""
    command = [sys.executable, "-m", "symgrasp", "serve", "--port", str(PORT), *LIGHT, "-q"]
    with subprocess.Popen(command) as server:
        try:
            wait_for(server, PORT)
            return _posted(psutil.Process(server.pid))
        finally:
            server.terminate()


def wait_for(server: "subprocess.Popen[bytes]", port: int) -> None:
    """Wait until `server` answers."""
    while server.poll() is None:
        try:
            urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=1).close()
            return
        except OSError:
            time.sleep(0.2)
    raise SystemExit("the server did not start")


def _posted(server: psutil.Process) -> list[Measurement]:
    body, seconds = _body(), []
    with ThreadPoolExecutor(CLIENTS) as pool:
        list(pool.map(_post, [body] * WARM))
        before, started = server.memory_info().rss, time.monotonic()
        seconds = list(pool.map(_post, [body] * (POSTS - WARM)))
        rate = len(seconds) / (time.monotonic() - started)
    after = server.memory_info().rss
    note = f"{POSTS} posts, {CLIENTS} clients, no networks"
    return [
        Measurement("serve: median", float(np.median(seconds)), "s/post", note),
        Measurement("serve: 99 %", float(np.quantile(seconds, 0.99)), "s/post", note),
        Measurement("serve: rate", rate, "posts/s", note),
        Measurement("serve: memory", after / 1e6, "MB", f"{(after - before) / 1e6:+.0f} since 100"),
    ]


def _post(body: bytes) -> float:
    """Return the seconds that a post takes."""
    started = time.monotonic()
    request = urllib.request.Request(f"{URL}/grasps", body, {"Content-Type": "application/json"})
    with urllib.request.urlopen(request, timeout=600) as answer:
        answer.read()
    return time.monotonic() - started


def _body() -> bytes:
    files = [WEIGHTS / "frames" / f"table_1_{end}" for end in ("color.png", "depth.png")]
    color, depth = (b64encode(file.read_bytes()).decode() for file in files)
    camera = json.loads((WEIGHTS / "frames" / "table_1_camera.json").read_text(encoding="utf-8"))
    return json.dumps({"color": color, "depth": depth, "intrinsics": camera}).encode()
