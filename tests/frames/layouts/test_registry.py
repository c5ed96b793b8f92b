"""Every layout is recognised, and gives the same frames as the flat folder."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.errors import SymgraspError
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.frames.layouts.registry import LAST_RESORT, LAYOUTS
from pipelines.frames.rgbd import Frame
from tests.frames.layouts import build

CAMERA = CameraFile(*build.FOUR)
REAL = ("ucn_000000", "ucn_000004")
ROUNDING = {"tum": 1e-4}  # m; the others keep the flat folder's millimetres
JPEGS = {"open3d_realsense", "scannet"}


@pytest.mark.parametrize("key", build.LAYOUTS)
def test_each_layout_is_recognised_and_read(tmp_path: Path, key: str) -> None:
    name, write = build.LAYOUTS[key]
    write(tmp_path)
    sources = find_frames(tmp_path, FrameOptions(CAMERA if key == "tum" else None))
    assert {source.layout for source in sources} == {name}
    for i, source in enumerate(sources):
        frame, index = source.read(), 0 if key == "pcd" else i
        assert frame.name == source.name
        assert_allclose(frame.depth, build.depth(index) / 1000.0, atol=1e-6)
        assert_array_equal(frame.color, build.color(index))
        camera = frame.intrinsics
        assert_allclose([camera.fx, camera.fy, camera.cx, camera.cy], build.FOUR, atol=1e-4)
        assert all(path.is_file() for path in source.files)


def test_every_registered_layout_is_tried_above() -> None:
    written = {name for name, _write in build.LAYOUTS.values()}
    assert written | {"ROS bag"} == {layout.name for layout in LAYOUTS}  # bags: test_rosbag


def test_every_layout_is_in_the_document() -> None:
    page = Path(__file__).resolve().parents[3] / "docs" / "reference" / "formats.md"
    document = page.read_text(encoding="utf-8")
    for layout in (*LAYOUTS, LAST_RESORT):
        assert f"\n| {layout.name}" in document


def test_names_are_relative_to_the_folder_given(tmp_path: Path) -> None:
    for scene in ("000001", "000002"):
        (tmp_path / scene).mkdir()
        build.bop_scene(tmp_path / scene)
    names = [source.name for source in find_frames(tmp_path)]
    assert names == ["000001/000000", "000001/000001", "000002/000000", "000002/000001"]


def test_the_frames_of_each_bop_sensor_are_named_below_its_name(tmp_path: Path) -> None:
    build.bop_scene(tmp_path)
    build.bop_sensor(tmp_path)
    names = [source.name for source in find_frames(tmp_path)]
    assert names == ["000000", "000001", "photoneo/000000", "photoneo/000001"]


def test_one_file_given_alone_is_read_as_its_frame(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    build.contact_graspnet(tmp_path / "b")
    (source,) = find_frames(tmp_path / "b/1.npz")
    assert source.name == "1"


def test_an_image_in_a_sister_folder_is_read_as_its_frame(tmp_path: Path) -> None:
    build.recorder(tmp_path)
    (source,) = find_frames(tmp_path / "depth/000001.png")
    assert source.name == "000001"


def test_an_image_with_a_word_in_a_sister_folder_is_read_as_its_frame(tmp_path: Path) -> None:
    build.pair(tmp_path / "rgb/color_0.png", tmp_path / "depth/depth_0.png", 0)
    for image in ("rgb/color_0.png", "depth/depth_0.png"):
        (source,) = find_frames(tmp_path / image)
        assert (source.name, source.is_whole) == ("0", True)
    (tmp_path / "depth/depth_0.png").unlink()
    (source,) = find_frames(tmp_path / "rgb/color_0.png")
    assert not source.is_whole


def test_a_stray_pickle_hides_no_frames_below(tmp_path: Path) -> None:
    np.save(tmp_path / "notes.npy", {"a": 1}, allow_pickle=True)
    (tmp_path / "frames").mkdir()
    build.flat(tmp_path / "frames")
    assert [source.name for source in find_frames(tmp_path)] == ["frames/0", "frames/1"]


def test_a_bag_hides_no_images_that_were_taken_out_of_it(tmp_path: Path) -> None:
    build.recorder(tmp_path)
    (tmp_path / "recording.bag").write_bytes(b"#ROSBAG V2.0")
    assert {source.layout for source in find_frames(tmp_path)} == {"Open3D / RealSense recorder"}


@pytest.fixture(scope="module")
def laid_out(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two real frames in the layouts that other tools write."""
    pytest.importorskip("PIL")
    folder = tmp_path_factory.mktemp("layouts")
    frames = [str(shared / "frames/ucn_realsense" / name) for name in REAL]
    tool = shared / "tools/make_layouts.py"
    subprocess.run([sys.executable, tool, folder, *frames], check=True, capture_output=True)
    return folder


def flat_frames(shared: Path) -> list[Frame]:
    sources = find_frames(shared / "frames/ucn_realsense")
    return [source.read() for source in sources if source.name in REAL]


@pytest.mark.parametrize(
    "layout",
    ["graspnet_scene", "graspnet_demo", "bop", "open3d_realsense", "contact_graspnet",
     "foundationpose", "tum", "princeton", "nerfstudio", "scannet"],
)  # fmt: skip
def test_real_frames_are_the_same_in_every_layout(
    laid_out: Path, shared: Path, layout: str
) -> None:
    expected = flat_frames(shared)
    camera = CameraFile.of(expected[0].intrinsics) if layout == "tum" else None
    frames = [source.read() for source in find_frames(laid_out / layout, FrameOptions(camera))]
    assert len(frames) == (1 if layout == "graspnet_demo" else 2)
    for frame, flat in zip(frames, expected, strict=False):
        seen = flat.depth < 65534 / 5000 if layout == "tum" else np.full(flat.depth.shape, True)
        assert_allclose(frame.depth[seen], flat.depth[seen], atol=ROUNDING.get(layout, 1e-6))
        if layout in JPEGS:
            difference = frame.color.astype(float) - flat.color
            assert np.abs(difference).mean() < 4.0
        else:
            assert_array_equal(frame.color, flat.color)
        assert frame.intrinsics == flat.intrinsics


def test_colourised_depth_is_refused(laid_out: Path) -> None:
    (source,) = find_frames(laid_out / "bad_colourised_depth")
    with pytest.raises(SymgraspError, match="3 channels, as a colourised picture"):
        source.read()


NATIVE = {  # of each real folder, the layout it is read as, or the sentence that refuses it
    "6dofgraspnet_realsense": "pickled dictionary.*convert-frames",
    "arc_sr300": r"--depth-units-per-metre: they would be .*0\.53.* m under 10000",
    "gqcnn_phoxi": None,
    "graspnet_user": None,
    "m2t2_realsense": "holds no RGB-D frames",
    "morefusion_d435": None,
    "mosd": None,
    "posecnn_realsense": None,
    "ucn_realsense": None,
    "zerograsp_stereo": "holds no RGB-D frames",
}


@pytest.mark.parametrize("folder", NATIVE)
def test_native_files_are_read_or_refused_with_a_sentence(shared: Path, folder: str) -> None:
    sentence = NATIVE[folder]
    native = shared / "frames" / folder / "native"
    if sentence is None:
        for source in find_frames(native):
            assert source.read().depth.max() > 0
        return
    with pytest.raises(SymgraspError, match=sentence):
        find_frames(native)[0].read()


def test_a_native_cloud_gives_the_converted_frame(shared: Path) -> None:
    (source,) = find_frames(shared / "frames/mosd/native")
    cloud = source.read()
    flat = {s.name: s for s in find_frames(shared / "frames/mosd")}["learn40"].read()
    assert_allclose(cloud.depth, flat.depth, atol=5e-4)  # stored as millimetres there
    assert_array_equal(cloud.color, flat.color)
    assert_allclose(cloud.intrinsics.matrix, flat.intrinsics.matrix, atol=1e-4)
