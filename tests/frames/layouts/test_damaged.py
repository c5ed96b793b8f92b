"""Damaged files of every kind give an error sentence or a result, never a traceback.

`SYMGRASP_MUTATIONS=200 pytest tests/frames/layouts/test_damaged.py` tries harder.
"""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipelines.errors import SymgraspError
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.frames import find_frames
from tests.frames.layouts import build

CAMERA = CameraFile(*build.FOUR)
MUTATIONS = settings(
    max_examples=int(os.environ.get("SYMGRASP_MUTATIONS", "25")),  # 200 find no more,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
# The layout, and the damaged file in it.
BINARY = [
    ("graspnet_scene", "depth/0000.png"),
    ("graspnet_scene", "rgb/0000.png"),
    ("graspnet_scene", "camK.npy"),
    ("graspnet_demo", "meta.mat"),
    ("gqcnn", "depth_0.npy"),
    ("contact_graspnet", "0.npz"),
    ("blenderproc", "0.hdf5"),
    ("pcd", "0.pcd"),
    ("pcd", "1.pcd"),
    ("pcd", "2.pcd"),
    ("flat", "0_color.jpg"),
    ("flat", "0_depth.tif"),
    ("tum", "rgb.txt"),
    ("foundation_pose", "cam_K.txt"),
    ("arkit_scenes", "lowres_wide_intrinsics/41069021_305.371.pincam"),
    ("flat", "camera_info.yaml"),
    ("flat", "0_camera.json"),
]
BELOW = ("depth", "rgb", "lowres_wide_intrinsics")
JSON = [
    ("nerfstudio", "transforms.json"),
    ("bop_scene", "scene_camera.json"),
    ("bop_image", "camera.json"),
    ("megapose", "camera_data.json"),
    ("recorder", "camera_intrinsic.json"),
    ("gqcnn", "phoxi.intr"),
]
WORDS = [b"nan", b"inf", b"-1", b"1e999", b"9" * 5000, b"null", b"[", b"{", b'"', b"\x00", b"\n"]
ODD_VALUES: list[Any] = [None, True, -1, 0, 1e308, "x", "", [], {}, [[]], {"data": 3}, [1, 2, 3]]


def read_everything(folder: Path) -> None:
    """Find and read all frames; a frame that cannot be read must raise one sentence."""
    stated = FrameOptions(CAMERA if (folder / "rgb.txt").exists() else None)
    try:
        sources = find_frames(folder, stated)
    except SymgraspError:
        return
    for source in sources:
        try:
            frame = source.read()
        except SymgraspError:
            continue
        assert frame.depth.shape == frame.color.shape[:2]
        assert np.isfinite(frame.depth).all()
        assert frame.depth.min() >= 0


@st.composite
def mutations(draw: st.DrawFn) -> Callable[[bytes], bytes]:
    """Cut, flip, insert, delete and repeat pieces; several at a time."""
    steps = draw(
        st.lists(
            st.tuples(
                st.sampled_from(["cut", "flip", "insert", "delete", "repeat"]),
                st.floats(0, 1),
                st.integers(0, 40),
                st.sampled_from(WORDS),
            ),
            min_size=1,
            max_size=4,
        )
    )

    def mutate(data: bytes) -> bytes:
        for kind, place, length, word in steps:
            at = int(place * len(data))
            piece = data[at : at + length]
            match kind:
                case "cut":
                    data = data[:at]
                case "flip":
                    data = data[:at] + bytes(b ^ (length + 1) for b in piece) + data[at + length :]
                case "insert":
                    data = data[:at] + word + data[at:]
                case "delete":
                    data = data[:at] + data[at + length :]
                case _:
                    data = data[:at] + piece * 3 + data[at:]
        return data

    return mutate


@pytest.fixture(params=BINARY, ids="/".join)
def bytes_file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    key, name = request.param
    build.LAYOUTS[key][1](tmp_path)
    file = tmp_path / name
    if key == "flat" and not file.exists():  # another kind of file in the place of the usual one
        for other in tmp_path.glob("1_*"):
            other.unlink()
        if name.endswith(".yaml"):
            (tmp_path / "0_camera.json").unlink()
            lines = f"height: {build.HEIGHT}\nwidth: {build.WIDTH}\nK: {build.K.ravel().tolist()}\n"
            file.write_text(lines)
        else:
            stem = file.stem.split("_")[1]
            (tmp_path / f"0_{stem}.png").unlink()
            build.image(file, getattr(build, stem)(0))
    return file


def test_undamaged_files_are_read(bytes_file: Path) -> None:
    folder = bytes_file.parent
    folder = folder.parent if folder.name in BELOW else folder
    camera = CAMERA if bytes_file.name == "rgb.txt" else None
    for source in find_frames(folder, FrameOptions(camera)):
        source.read()


def test_damaged_bytes_give_a_sentence_or_an_answer(bytes_file: Path) -> None:
    whole = bytes_file.read_bytes()
    folder = bytes_file.parent
    folder = folder.parent if folder.name in BELOW else folder

    @MUTATIONS
    @given(mutations())
    def try_one(mutate: Callable[[bytes], bytes]) -> None:
        bytes_file.write_bytes(mutate(whole))
        read_everything(folder)

    try_one()


@pytest.mark.parametrize(("key", "name"), JSON, ids=map("/".join, JSON))
def test_odd_values_in_json_give_a_sentence_or_an_answer(
    tmp_path: Path, key: str, name: str
) -> None:
    build.LAYOUTS[key][1](tmp_path)
    content = json.loads((tmp_path / name).read_text())

    @MUTATIONS
    @given(st.data())
    def try_one(data: st.DataObject) -> None:
        (tmp_path / name).write_text(json.dumps(_with_an_odd_value(content, data)))
        read_everything(tmp_path)

    try_one()


def _with_an_odd_value(content: Any, data: st.DataObject) -> Any:
    """Return a copy of JSON with one value, however deep, replaced or taken out."""
    if not isinstance(content, dict | list) or not content or data.draw(st.integers(0, 4)) == 0:
        return data.draw(st.sampled_from(ODD_VALUES))
    keys = list(content) if isinstance(content, dict) else list(range(len(content)))
    key = data.draw(st.sampled_from(keys))
    if isinstance(content, dict):
        if data.draw(st.integers(0, 5)) == 0:
            return {k: v for k, v in content.items() if k != key}
        return content | {key: _with_an_odd_value(content[key], data)}
    return [*content[:key], _with_an_odd_value(content[key], data), *content[key + 1 :]]


def test_json_that_is_nested_without_end_is_reported_in_one_sentence(tmp_path: Path) -> None:
    build.bop_scene(tmp_path)
    (tmp_path / "scene_camera.json").write_text("[" * 100_000)
    with pytest.raises(SymgraspError, match="not JSON"):
        find_frames(tmp_path)[0].read()
