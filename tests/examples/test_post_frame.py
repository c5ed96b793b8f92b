"""The example that posts a frame, at servers that end in the middle of it."""

import errno
import json
import os
import runpy
import socket
import struct
import subprocess
import sys
import urllib.request
from io import BytesIO

import pytest

from examples import post_frame

RESET = struct.pack("ii", 1, 0)  # of SO_LINGER: closing resets the connection
PART = b"HTTP/1.1 200 OK\r\nContent-Length: 99\r\n\r\n{"


def test_a_frame_without_grasps_is_printed_with_its_reason(tmp_path, monkeypatch, capsys):
    found = {"grasps": [], "message": "nothing stands out"}
    monkeypatch.setattr(
        urllib.request, "urlopen", lambda *_a, **_k: BytesIO(json.dumps(found).encode())
    )
    files = [tmp_path / name for name in ("color", "depth", "camera")]
    for path in files:
        path.write_text("{}")
    monkeypatch.setattr(sys, "argv", ["post_frame.py", *map(str, files)])
    runpy.run_path(post_frame.__file__, run_name="__main__")
    assert capsys.readouterr().out == "nothing stands out\n"


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (b"", str(OSError(errno.ECONNRESET, os.strerror(errno.ECONNRESET)))),
        (PART, "IncompleteRead(1 bytes read, 98 more expected)"),
    ],
    ids=["reset", "part"],
)
def test_a_server_that_ends_meanwhile_is_reported_in_one_sentence(answer, reason, tmp_path):
    files = [tmp_path / name for name in ("color", "depth", "camera")]
    for path in files:
        path.write_text("{}")
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"http://127.0.0.1:{server.getsockname()[1]}/grasps"
        command = [sys.executable, post_frame.__file__, *map(str, files), url]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as client:
            connection, _ = server.accept()
            with connection:
                received = b""
                while not received.endswith(b"{}}"):
                    received += connection.recv(1000)
                connection.sendall(answer)
                if not answer:
                    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
            assert client.stderr.read() == f"no answer ({reason})\n"
    assert client.returncode == 1


def test_a_camera_that_is_no_json_is_reported_in_one_sentence(tmp_path):
    picture = tmp_path / "color.png"
    picture.write_bytes(b"\x89PNG")
    command = [sys.executable, post_frame.__file__, *[str(picture)] * 3]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert done.stderr.startswith("no answer ('utf-8' codec can't decode")
