"""Stage `serve`: grasps over HTTP, from models that are loaded once.

Reads   frames, posted to /grasps as JSON
Writes  nothing; answers with the grasps of the frame, in the form of `export --to json`

By default the server listens on this machine alone, as it checks no passwords. It ends on SIGTERM
or Ctrl-C, once the frames in progress are answered or the grace period is over.
"""

import errno
import json
import socket
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines.configs import ExportConfig, ServeConfig
from pipelines.errors import SymgraspError
from pipelines.grasp_files.exports.export_poses import ExportGripper, pose_frame, pose_origin
from pipelines.grasp_files.exports.grasp_exports import FrameGrasps
from pipelines.grasp_files.exports.grasp_json import frame_text
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.grasping.gripper import Gripper

if TYPE_CHECKING:
    from fastapi import FastAPI

    from pipelines.serving.posted_frames import PostedFrame

STAGE = "serve"
LOOPBACK = ("127.0.0.1", "::1", "localhost")
NO_SUCH_ADDRESS = {errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT}
# Seconds and number of the probes of silent clients: one that lost its network is noticed in a
# minute. Systems differ in the options they have; macOS calls the first one TCP_KEEPALIVE.
PROBES = {"TCP_KEEPIDLE": 30, "TCP_KEEPALIVE": 30, "TCP_KEEPINTVL": 10, "TCP_KEEPCNT": 3}
Detect = Callable[..., FrameResult]  # (color, depth, intrinsics, **options)


def app_of(
    detect: Detect, gripper: Gripper, config: ServeConfig, camera_to_base: Path | None = None
) -> "FastAPI":
    """Return the HTTP application.

    `detect`: returns the regions and grasps of a frame, as `GraspDetector.frame_result` does.
    `camera_to_base`: hand-eye calibration, for poses in the robot's base frame.

    Raises:
        SymgraspError: the extra is not installed, or the calibration cannot be read.
    """
    try:
        from pipelines.serving.http_app import make_app  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise SymgraspError('serve needs FastAPI: pip install "symgrasp[serve]"') from error
    frame = pose_frame(camera_to_base, ExportConfig.frame_id)
    behind, origin = pose_origin(config.tcp, gripper, gripper.base_to_contacts)
    exported = ExportGripper(gripper, behind, gripper.name, origin=origin)
    facts: dict[str, Any] = {"gripper": exported.facts(), "axes": frame.axes}
    head = json.dumps(facts).removesuffix("}")

    def answer(posted: "PostedFrame") -> str:
        result = detect(posted.color, posted.depth, **posted.options)
        found = FrameGrasps.of(result, 0, exported, config.min_score, frame)
        return f"{head}, {frame_text(found, posted.name).lstrip().removeprefix('{')}"

    return make_app(answer, facts, config)


def listening(config: ServeConfig) -> list[socket.socket]:
    """Return sockets that listen on all addresses of the host that this machine has.

    Raises:
        SymgraspError: the host is unknown, or the port is in use or not allowed.
    """
    opened: list[socket.socket] = []
    try:
        found = socket.getaddrinfo(config.host, config.port, type=socket.SOCK_STREAM)
        # IPv4 first: a machine without IPv6 may have an IPv6 address for `localhost`.
        for family, _kind, _protocol, _name, address in sorted(dict.fromkeys(found)):
            try:
                opened.append(_probing(socket.create_server(address[:2], family=family)))
            except OSError as error:
                if not opened or error.errno not in NO_SUCH_ADDRESS:
                    raise
    except (OSError, UnicodeError) as error:  # the latter of names that no host has, as ".local"
        for each in opened:
            each.close()
        why = error.strerror if isinstance(error, OSError) else "this is no name of a host"
        reason = str(why).partition(" (while")[0]
        where = f"--host {config.host} --port {config.port}"
        sentence = f"{where} cannot be listened on ({reason}); choose another port or address"
        raise SymgraspError(sentence) from error
    return opened


def _probing(listener: socket.socket) -> socket.socket:
    """Return `listener`, whose connections, which inherit its options, end if a client is dead."""
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in PROBES.items():
        if hasattr(socket, name):
            listener.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
    return listener


def run(app: "FastAPI", config: ServeConfig, sockets: list[socket.socket]) -> None:
    """Serve until SIGTERM or Ctrl-C; frames in progress are answered within the grace period.

    A second signal ends the server at once. `sockets`: the result of `listening`.

    Raises:
        SymgraspError: the extra is not installed.
    """
    try:
        from pipelines.serving.http_server import GraspServer  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise SymgraspError('serve needs uvicorn: pip install "symgrasp[serve]"') from error
    GraspServer(app, config).run(sockets)
