"""Inputs of attacks that are no files of datasets: bags, EXR, a posted frame, a gripper's URDF."""

import base64
import json
import sys
from pathlib import Path

import cv2
import numpy as np
import OpenEXR

from tests.frames.layouts import build
from tests.frames.layouts.test_rosbag import write_bag
from tests.frames.layouts.test_rosbag_compressed import PNG_COLOR, compressed_depth
from tests.stages.test_gripper import URDF

POST = "post"  # the first word of a line that posts a frame to `serve`
BAGS = ("bag1", "bag2", "compressed", "mcap")


def write_services(folder: Path) -> None:
    """Write bags, frames with EXR depth, the body of a posted frame, and a URDF into `folder`."""
    for name in BAGS:
        (folder / "frames" / name).mkdir(parents=True)
    write_bag(folder / "frames/bag1/a.bag", ros=1)
    write_bag(folder / "frames/bag2/a", ros=2)
    depth = ("16UC1; compressedDepth png", compressed_depth)
    write_bag(folder / "frames/compressed/a", packed=PNG_COLOR | {"depth": depth})
    _write_mcap(folder / "frames/mcap/a")
    _write_exr(folder / "frames/exr")
    (folder / "hand.urdf").write_text(URDF)
    _write_post(folder / "post.json")


def post(path: Path) -> int:
    """Post the file to the application of `serve`; return 0 if answered, 1 if refused.

    A failure of the server itself is raised.
    """
    from fastapi.testclient import TestClient

    from pipelines import serve
    from pipelines.configs import InferConfig, ServeConfig
    from symgrasp.detector import GraspDetector

    settings = InferConfig(regions="geometric", method="planar")
    detector = GraspDetector(device="cpu", settings=settings)
    app = serve.app_of(detector.frame_result, detector.gripper, ServeConfig())
    head = {"Content-Type": "application/json"}
    answer = TestClient(app).post("/grasps", content=path.read_bytes(), headers=head)
    sys.stdout.write(f"{answer.status_code} {answer.text[:300]}\n")
    if answer.status_code >= 500:
        raise RuntimeError(answer.text)
    return 0 if answer.status_code == 200 else 1


def _write_mcap(path: Path) -> None:
    from rosbags.rosbag2 import Reader, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    plain = path.with_name("plain")
    write_bag(plain, ros=2)
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(plain) as reader, Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as new:
        opened = {
            each.id: new.add_connection(each.topic, each.msgtype, typestore=store)
            for each in reader.connections
        }
        for connection, stamp, data in reader.messages():
            new.write(opened[connection.id], stamp, data)
    for file in plain.iterdir():
        file.unlink()
    plain.rmdir()


def _write_exr(folder: Path) -> None:
    folder.mkdir(parents=True)
    cv2.imwrite(str(folder / "a_color.png"), build.color(0))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"Z": build.depth(0).astype(np.float32) / 1000}) as file:
        file.write(str(folder / "a_depth.exr"))
    camera = {"K": build.K.tolist(), "width": build.WIDTH, "height": build.HEIGHT}
    (folder / "a_camera.json").write_text(json.dumps(camera))


def _write_post(path: Path) -> None:
    color, depth = (
        base64.b64encode(cv2.imencode(".png", image)[1].tobytes()).decode()
        for image in (build.color(0), build.depth(0))
    )
    mask = np.ones((build.HEIGHT, build.WIDTH), np.uint8)
    raw = base64.b64encode(mask.tobytes()).decode()
    content = {
        "color": color,
        "depth": depth,
        "intrinsics": {"fx": 60.0, "fy": 61.0, "cx": 23.5, "cy": 17.5},
        "depth_units_per_metre": 1000,
        "workspace": [-1, -1, 0, 1, 1, 2],
        "masks": {"shape": list(mask.shape), "dtype": "uint8", "data": raw},
        "name": "frame",
    }
    path.write_text(json.dumps(content))
