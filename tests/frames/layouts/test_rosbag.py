"""ROS 1 and ROS 2 bags: topics, encodings, cameras, damage."""

import os
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from numpy.testing import assert_array_equal

from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.encodings.ros_bags import CAMERA, COMPRESSED, IMAGE, open_bag
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.frames import find_frames
from tests.frames.layouts import build
from tests.frames.layouts.test_damaged import MUTATIONS, mutations, read_everything

pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
METRES = build.depth(0).astype(np.float32) / 1000
TOPICS = {
    "color": "/camera/color/image_raw",
    "depth": "/camera/aligned_depth_to_color/image_raw",
    "info": "/camera/color/camera_info",
}
Packed = dict[str, tuple[str, Callable[[np.ndarray], bytes]]]
KINDS = {"color": IMAGE, "depth": IMAGE, "info": CAMERA}


def write_bag(
    path: Path,
    *,
    ros: int = 2,
    depth: str = "16UC1",
    color: str = "rgb8",
    padding: int = 0,
    big: bool = False,
    topics: dict[str, str] = TOPICS,
    more: tuple[dict[str, str], ...] = (),
    delay: float = 0.004,
    recorded: Callable[[float], int] = lambda seconds: round(seconds * 1e9) + 500,
    packed: Packed | None = None,
    lens: tuple[float, ...] = (0.0,) * 5,
) -> None:
    """Write COUNT frames of the camera of `topics`, and of `more` cameras that are upside down.

    The depth is taken `delay` seconds after the colour; `recorded` maps an image's seconds to
    its time of recording, in nanoseconds. `packed`: the format of the colour's or the depth's
    CompressedImage, and the function that makes its bytes. `lens`: the distortion in the
    CameraInfo, whose projection matrix then has other focal lengths.
    """
    packed = packed or {}
    kinds = KINDS | dict.fromkeys(packed, COMPRESSED)
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    types = store.types
    serialize = store.serialize_ros1 if ros == 1 else store.serialize_cdr

    def header(seconds: float) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](int(seconds), round(seconds % 1 * 1e9))
        first = (0,) if ros == 1 else ()
        return types["std_msgs/msg/Header"](*first, stamp, "camera")

    def message(seconds: float, stored: np.ndarray, encoding: str, kind: str) -> Any:
        if kind in packed:
            how, encode = packed[kind]
            data = np.frombuffer(encode(stored), np.uint8)
            return types[COMPRESSED](header(seconds), how, data)
        rows = np.ascontiguousarray(stored).reshape(build.HEIGHT, -1).view(np.uint8)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        return types["sensor_msgs/msg/Image"](
            header(seconds), build.HEIGHT, build.WIDTH, encoding, int(big), rows.shape[1],
            rows.ravel(),
        )  # fmt: skip

    def camera(seconds: float) -> Any:
        roi = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        K = build.K + np.diag([5.0, 5.0, 0.0]) * any(lens)
        P = np.hstack([K, np.zeros((3, 1))]).ravel()
        return types["sensor_msgs/msg/CameraInfo"](
            header(seconds), build.HEIGHT, build.WIDTH, "plumb_bob", np.array(lens),
            build.K.ravel(), np.eye(3).ravel(), P, 0, 0, roi,
        )  # fmt: skip

    def messages(i: int, turn: int) -> dict[str, tuple[float, Any]]:
        seconds = 1000.0 + i / 30
        image = build.color(i) if color == "rgb8" else build.color(i)[:, :, ::-1]
        stored = build.depth(i).astype(">u2" if big else "<u2")
        image, stored = image[::turn], stored[::turn]
        if depth == "32FC1":
            stored = np.where(stored == 0, np.nan, stored / 1000).astype("<f4")
        return {
            "color": (seconds, message(seconds, image, color, "color")),
            "depth": (seconds + delay, message(seconds + delay, stored, depth, "depth")),
            "info": (seconds, camera(seconds)),
        }

    with Writer1(path) if ros == 1 else Writer2(path, version=9) as writer:
        cameras = [
            {kind: writer.add_connection(topic, kinds[kind], typestore=store)
             for kind, topic in each.items()}
            for each in (topics, *more)
        ]  # fmt: skip
        for i, (at, opened) in product(range(build.COUNT), enumerate(cameras)):
            for kind, (seconds, content) in messages(i, -1 if at else 1).items():
                if kind in opened:
                    raw = serialize(content, content.__msgtype__)
                    writer.write(opened[kind], recorded(seconds), raw)


@pytest.mark.parametrize(
    "how",
    [{}, {"depth": "32FC1"}, {"color": "bgr8"}, {"padding": 6}, {"big": True}, {"depth": "mono16"}],
)
@pytest.mark.parametrize("ros", [1, 2])
def test_every_encoding_gives_the_same_frames(
    tmp_path: Path, ros: int, how: dict[str, Any]
) -> None:
    write_bag(tmp_path / ("a.bag" if ros == 1 else "a"), ros=ros, **how)
    sources = find_frames(tmp_path)
    assert {source.layout for source in sources} == {"ROS bag"}
    assert len({source.name for source in sources}) == build.COUNT
    for i, source in enumerate(sources):
        frame = source.read()
        assert frame.name == source.name
        assert frame.name.startswith("a/")
        assert np.abs(frame.depth - build.depth(i) / np.float32(1000)).max() < 1e-6
        assert_array_equal(frame.color, build.color(i))
        assert frame.intrinsics.matrix.tolist() == build.K.tolist()
        assert frame.notes == ()


def test_a_single_bag_may_be_given(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", ros=1)
    write_bag(tmp_path / "b.bag", ros=1)
    assert len(find_frames(tmp_path / "b.bag")) == build.COUNT


def test_depth_whose_topic_is_not_called_aligned_gives_a_warning(tmp_path: Path) -> None:
    depth = {"depth": "/camera/depth/image_rect_raw", "info": "/camera/depth/camera_info"}
    write_bag(tmp_path / "a", topics=TOPICS | depth)
    assert "not called aligned" in find_frames(tmp_path)[0].read().notes[0]


def test_a_bag_without_a_camera_is_refused_with_the_option_for_it(tmp_path: Path) -> None:
    write_bag(tmp_path / "a", topics={key: TOPICS[key] for key in ("color", "depth")})
    with pytest.raises(FormatError, match="--intrinsics"):
        find_frames(tmp_path)[0].read()
    frame = find_frames(tmp_path, FrameOptions(CameraFile(*build.FOUR)))[0].read()
    assert frame.intrinsics.fx == build.FOUR[0]


@pytest.mark.parametrize(
    ("how", "sentence"),
    [
        ({"topics": {"color": "/c", "info": "/i"}}, "has no depth images; its topics are /c, /i"),
        ({"topics": {"depth": "/d"}}, "has no colour images"),
        ({"delay": 5.0}, "of one time"),
    ],
)
def test_bags_without_frames_are_reported_in_one_sentence(
    tmp_path: Path, how: dict[str, Any], sentence: str
) -> None:
    write_bag(tmp_path / "a", **how)
    with pytest.raises(SymgraspError, match=sentence):
        find_frames(tmp_path)[0].read()


@pytest.mark.parametrize("name", ["a.bag", "a.mcap"])
def test_an_empty_recording_is_a_damaged_bag(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"")
    with pytest.raises(FormatError, match=rf"{name}: this bag is damaged"):
        find_frames(tmp_path)[0].read()


@pytest.mark.parametrize("ros", [1, 2])
def test_damaged_bags_give_a_sentence_or_frames(tmp_path: Path, ros: int) -> None:
    write_bag(tmp_path / ("a.bag" if ros == 1 else "a"), ros=ros)
    files = [tmp_path / "a.bag"] if ros == 1 else sorted((tmp_path / "a").iterdir())
    whole = {file: file.read_bytes() for file in files}

    @MUTATIONS
    @given(mutations())
    def try_one(mutate: Callable[[bytes], bytes]) -> None:
        for file in files:
            for each, data in whole.items():
                each.write_bytes(mutate(data) if each == file else data)
            read_everything(tmp_path)

    try_one()


def test_a_real_bag_gives_the_frames_of_the_flat_folder(shared: Path, tmp_path: Path) -> None:
    pytest.importorskip("PIL")
    import subprocess
    import sys

    prefix = shared / "frames/ucn_realsense/ucn_000000"
    tool = [sys.executable, str(shared / "tools/make_layouts.py"), str(tmp_path), str(prefix)]
    subprocess.run(tool, check=True, capture_output=True, env=os.environ)
    frame = find_frames(tmp_path / "ros2_bag")[0].read()
    flat = {s.name: s for s in find_frames(prefix.parent)}["ucn_000000"].read()
    assert_array_equal(frame.depth, flat.depth)
    assert_array_equal(frame.color, flat.color)
    assert frame.intrinsics == flat.intrinsics


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
def test_a_pipe_in_the_place_of_a_part_is_refused_without_waiting(tmp_path, suffix):
    write_bag(tmp_path / "bag")
    (part,) = (tmp_path / "bag").glob("*.db3")
    metadata = tmp_path / "bag" / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(part.name, f"part{suffix}"))
    part.unlink()
    os.mkfifo(tmp_path / "bag" / f"part{suffix}")
    with (
        pytest.raises(SymgraspError, match=f"part{suffix} is no plain file"),
        open_bag(tmp_path / "bag"),
    ):
        pass


def test_a_bag_that_names_files_outside_its_folder_is_refused(tmp_path):
    write_bag(tmp_path / "bag")
    metadata = tmp_path / "bag" / "metadata.yaml"
    (part,) = (tmp_path / "bag").glob("*.db3")
    metadata.write_text(metadata.read_text().replace(part.name, f"../{part.name}"))
    with (
        pytest.raises(SymgraspError, match=f"names the file ../{part.name}"),
        open_bag(tmp_path / "bag"),
    ):
        pass


@pytest.mark.parametrize("side", ["-journal", "-wal"])
def test_a_pipe_that_sqlite_would_open_beside_a_database_is_refused(tmp_path, side):
    write_bag(tmp_path / "bag")
    (part,) = (tmp_path / "bag").glob("*.db3")
    os.mkfifo(part.with_name(part.name + side))
    for bag in (part, tmp_path / "bag"):
        with pytest.raises(SymgraspError, match=f"{side} is no plain file"), open_bag(bag):
            pass
