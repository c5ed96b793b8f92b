"""BlenderProc: frames in HDF5, whose camera is often in a file next to them."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.frames import find_frames
from tests.frames.layouts import build


def text(content: object) -> np.bytes_:
    return np.bytes_(json.dumps(content))


def change(folder: Path, **arrays: object) -> Path:
    """Write the frames of `build`, with other datasets in the first; None removes one."""
    build.blenderproc(folder)
    with h5py.File(folder / "0.hdf5", "r+") as file:
        for name, each in arrays.items():
            if name in file:
                del file[name]
            if each is not None:
                file[name] = each
    return folder


POSE = {"cam_K": build.K.ravel().tolist(), "cam_R_w2c": [1.0] * 9, "cam_t_w2c": [0.0] * 3}
STATES = [{"cam2world_matrix": np.eye(4).tolist(), "cam_K": build.K.tolist()}]


@pytest.mark.parametrize(("name", "content"), [("camera_pose", POSE), ("campose", STATES)])
def test_the_camera_that_blenderproc_writes_is_read(
    tmp_path: Path, name: str, content: object
) -> None:
    change(tmp_path, **{name: text(content)})
    (tmp_path / "camera.json").unlink()
    frame = find_frames(tmp_path)[0].read()
    assert np.array_equal(frame.intrinsics.matrix, build.K)


def test_a_pose_without_a_matrix_leaves_the_camera_file(tmp_path: Path) -> None:
    change(tmp_path, camera_pose=text({"cam2world_matrix": np.eye(4).tolist()}))
    frame = find_frames(tmp_path)[0].read()
    assert np.array_equal(frame.intrinsics.matrix, build.K)


def test_the_sky_is_missing(tmp_path: Path) -> None:
    build.blenderproc(tmp_path)
    assert not find_frames(tmp_path)[0].read().depth[0, :2].any()


def test_frames_without_a_camera_are_refused(tmp_path: Path) -> None:
    build.blenderproc(tmp_path)
    (tmp_path / "camera.json").unlink()
    with pytest.raises(FormatError, match=r"give --intrinsics fx,fy,cx,cy, or put a camera file"):
        find_frames(tmp_path)[0].read()


@pytest.mark.parametrize(
    ("arrays", "sentence"),
    [
        ({"depth": None, "distance": np.ones((36, 48), "f4")}, "enable_depth_output"),
        ({"depth": np.ones((2, 36, 48), "f4")}, "depth is an array"),
        ({"colors": np.zeros((2, 36, 48, 3), "u1")}, "`colors` is an array"),
        ({"depth": np.bytes_("far")}, "depth"),
        ({"camera_pose": np.bytes_("[")}, "is not JSON"),
        ({"camera_pose": text([])}, "camera_pose"),
        ({"camera_pose": text("far")}, "camera_pose"),
        ({"campose": text([3])}, "campose"),
        ({"campose": np.zeros(3)}, "campose"),
    ],
)
def test_other_datasets_are_refused_in_one_sentence(
    tmp_path: Path, arrays: dict[str, object], sentence: str
) -> None:
    sources = find_frames(change(tmp_path, **arrays))
    with pytest.raises(FormatError, match=sentence):
        sources[0].read()


def test_hdf5_of_other_programs_is_no_frame(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "0.hdf5", "w") as file:
        file["data"] = np.zeros(3)
    (tmp_path / "1.hdf5").write_bytes(b"x")
    with pytest.raises(SymgraspError, match="holds no RGB-D frames"):
        find_frames(tmp_path)


def test_a_damaged_file_fails_alone_by_name(tmp_path: Path) -> None:
    build.blenderproc(tmp_path)
    data = (tmp_path / "0.hdf5").read_bytes()
    (tmp_path / "0.hdf5").write_bytes(data[: len(data) // 2])
    first, second = find_frames(tmp_path)
    with pytest.raises(FormatError, match="not a whole HDF5"):
        first.read()
    second.read()
