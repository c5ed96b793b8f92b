"""Grasps of a frame from `symgrasp serve`, with standard Python alone.

python post_frame.py color.png depth.png camera.json [http://127.0.0.1:8765/grasps]
"""

import argparse
import base64
import json
import sys
import urllib.request
from http.client import HTTPException
from pathlib import Path
from typing import Any
from urllib.error import HTTPError, URLError

URL = "http://127.0.0.1:8765/grasps"


def grasps_of(color: Path, depth: Path, camera: Path, url: str = URL) -> dict[str, Any]:
    """Return the server's response to a frame: PNG colour, 16-bit PNG depth, camera as JSON."""
    frame = {
        "color": base64.b64encode(color.read_bytes()).decode(),
        "depth": base64.b64encode(depth.read_bytes()).decode(),
        "intrinsics": json.loads(camera.read_text()),
    }
    headers = {"Content-Type": "application/json"}
    request = urllib.request.Request(url, json.dumps(frame).encode(), headers)
    with urllib.request.urlopen(request, timeout=60) as answer:
        return dict(json.load(answer))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("color", "depth", "camera"):
        parser.add_argument(name, type=Path)
    parser.add_argument("url", nargs="?", default=URL)
    try:
        found = grasps_of(**vars(parser.parse_args()))
    except HTTPError as refused:
        sys.exit(refused.read().decode())  # one sentence that names the problem of the frame
    except URLError as error:
        sys.exit(f"no server answers ({error.reason}); `symgrasp serve` says when it is ready")
    except (OSError, HTTPException, ValueError) as error:
        # A time-out, a server that ended meanwhile, or a camera that is no JSON.
        sys.exit(f"no answer ({error})")
    if not found["grasps"]:
        print(found["message"] or "no grasps")
    for grasp in found["grasps"][:3]:
        print(grasp["rank_score"], grasp["opening"], grasp["pose"])
