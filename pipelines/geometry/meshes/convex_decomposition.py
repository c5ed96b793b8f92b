"""Convex pieces of a mesh by coacd, in a child process.

On some meshes coacd's C++ code aborts its process, so a child process runs it,
`python -m pipelines.geometry.meshes.convex_decomposition`: arrays in on standard input, arrays
out on standard output. If the child dies, there are no pieces.

The child's limit is CPU time, so that a mesh has the same pieces on a busy and on an idle machine.
"""

import io
import json
import logging
import os
import signal
import subprocess
import sys
from collections.abc import Mapping

import numpy as np

from pipelines.array_types import Array
from pipelines.ending import end_with_parent
from pipelines.geometry.meshes.mesh import Mesh

log = logging.getLogger(__name__)

CPU_LIMIT = 600  # seconds; coacd takes one to a hundred
TIME_LIMIT = 7200.0  # seconds on the clock, for a child that hangs


def decomposed(mesh: Mesh, settings: Mapping[str, float]) -> list[Array]:
    """Return the corners (k, 3) of nearly convex pieces of `mesh`; none if coacd fails.

    `settings` are the keyword arguments of `coacd.run_coacd`.
    """
    request = io.BytesIO()
    np.savez(request, vertices=mesh.vertices, faces=mesh.faces)
    command = [sys.executable, "-m", __name__, json.dumps(settings), str(CPU_LIMIT)]
    try:
        answer = subprocess.run(
            command, input=request.getvalue(), capture_output=True, timeout=TIME_LIMIT, check=True
        )
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        log.warning(
            "coacd cannot cut a mesh of %d faces into convex pieces: %s",
            len(mesh.faces),
            _reason(error),
        )
        return []
    with np.load(io.BytesIO(answer.stdout), allow_pickle=False) as pieces:
        return [pieces[f"arr_{index}"] for index in range(len(pieces.files))]


def _reason(error: subprocess.CalledProcessError | subprocess.TimeoutExpired) -> str:
    """Return the end of the child process in words, without its command."""
    if isinstance(error, subprocess.TimeoutExpired):
        return f"it took more than {error.timeout:.0f} s"
    if error.returncode < 0:
        number = -error.returncode
        return f"signal {number} ended it ({signal.strsignal(number) or 'unknown'})"
    return f"it ended with exit code {error.returncode}"


def main() -> None:
    """Decompose the mesh on standard input."""
    end_with_parent(os.getppid())
    _limit_cpu_time(int(sys.argv[2]))
    import coacd  # noqa: PLC0415 - only the child loads it

    with np.load(io.BytesIO(sys.stdin.buffer.read()), allow_pickle=False) as request:
        mesh = coacd.Mesh(request["vertices"], request["faces"])
    coacd.set_log_level("off")
    pieces = coacd.run_coacd(mesh, **json.loads(sys.argv[1]))
    answer = io.BytesIO()
    np.savez(answer, *(np.asarray(vertices) for vertices, _ in pieces if len(vertices) >= 4))
    sys.stdout.buffer.write(answer.getvalue())


def _limit_cpu_time(seconds: int) -> None:
    """Let the system end this process after `seconds` of CPU time, where supported."""
    try:
        import resource  # noqa: PLC0415 - not on Windows
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))


if __name__ == "__main__":
    main()
