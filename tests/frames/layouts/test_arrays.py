"""Arrays in one `.npz`: their keys, the order of colours, and refused pickles."""

import pickle
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.frames import find_frames
from tests.frames.layouts import build

METRES = build.depth(0).astype(np.float32) / 1000


def refusal(folder: Path, name: str = "x.npz", **arrays: object) -> str:
    np.savez(folder / name, **arrays)
    with pytest.raises(FormatError, match=name) as caught:
        find_frames(folder)[0].read()
    return str(caught.value)


def test_a_cloud_without_depth_is_refused(tmp_path: Path) -> None:
    assert "point cloud without a depth" in refusal(tmp_path, xyz=np.zeros((9, 3)))


def test_a_frame_without_a_camera_is_refused_with_the_option_for_it(tmp_path: Path) -> None:
    assert "--intrinsics" in refusal(tmp_path, depth=METRES, rgb=build.color(0))


@pytest.mark.parametrize(
    "color", [np.zeros((4, 4), np.uint8), build.color(0).astype(float), np.zeros((0, 4, 3), "u1")]
)
def test_colour_of_a_wrong_shape_or_type_is_reported_in_one_sentence(
    tmp_path: Path, color: np.ndarray
) -> None:
    assert "`rgb` is" in refusal(tmp_path, depth=METRES, K=build.K, rgb=color)


@pytest.mark.parametrize("key", ["intrinsics", "intrinsic", "camera_matrix"])
def test_the_camera_has_the_names_of_camera_files(tmp_path: Path, key: str) -> None:
    np.savez(tmp_path / "x.npz", **{"depth": METRES, "image": build.color(0), key: build.K})
    assert find_frames(tmp_path)[0].read().intrinsics.fx == build.FOUR[0]


@pytest.mark.parametrize("key", ["image", "color", "colors"])
def test_colour_is_rgb_unless_its_key_is_that_of_contact_graspnet(tmp_path: Path, key: str) -> None:
    np.savez(tmp_path / "x.npz", **{"depth": METRES, "K": build.K, key: build.color(0)})
    np.savez(tmp_path / "y.npz", depth=METRES, K=build.K, rgb=build.color(0)[:, :, ::-1])
    for source in find_frames(tmp_path):
        assert np.array_equal(source.read().color, build.color(0))


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_colour_from_zero_to_one_is_read(tmp_path: Path, kind: type) -> None:
    image = (build.color(0) / 255).astype(kind)
    np.savez(tmp_path / "x.npz", depth=METRES, K=build.K, color=image)
    assert np.array_equal(find_frames(tmp_path)[0].read().color, build.color(0))


@pytest.mark.parametrize("value", [np.nan, -0.5, 1.5])
def test_colour_beyond_zero_to_one_is_refused(tmp_path: Path, value: float) -> None:
    image = build.color(0) / 255
    image[0, 0, 0] = value
    assert "`color` is" in refusal(tmp_path, depth=METRES, K=build.K, color=image)


def test_colours_of_points_are_no_image(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", depth=METRES, K=build.K, colors=np.zeros((9, 3), np.uint8))
    assert "grey" in find_frames(tmp_path)[0].read().notes[0]


def test_four_numbers_of_the_camera_may_be_arrays_of_their_own(tmp_path: Path) -> None:
    four = dict(zip(("fx", "fy", "cx", "cy"), build.FOUR, strict=True))
    np.savez(tmp_path / "x.npz", depth=METRES, image=build.color(0), **four)
    assert np.array_equal(find_frames(tmp_path)[0].read().intrinsics.matrix, build.K)


@pytest.mark.parametrize("name", ["x_camera.json", "camera.json"])
def test_the_camera_may_be_in_a_file_next_to_the_arrays(tmp_path: Path, name: str) -> None:
    np.savez(tmp_path / "x.npz", depth=build.depth(0), image=build.color(0))
    build.write(tmp_path / name, {"K": build.K.tolist(), "depth_scale": 0.0005})
    (source,) = find_frames(tmp_path)
    frame = source.read()
    assert frame.intrinsics.fx == build.FOUR[0]
    assert np.allclose(frame.depth, METRES / 2)
    assert tmp_path / name in source.files
    np.savez(tmp_path / "x.npz", depth=build.depth(0), image=build.color(0), K=2 * build.K)
    assert tmp_path / name not in find_frames(tmp_path)[0].files


def test_missing_colour_is_replaced_by_grey_and_reported(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", depth=METRES, K=build.K)
    frame = find_frames(tmp_path)[0].read()
    assert (frame.color == 128).all()
    assert "grey" in frame.notes[0]


def test_whole_numbers_are_read_as_millimetres(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", depth=build.depth(0), K=build.K)
    assert np.array_equal(find_frames(tmp_path)[0].read().depth, METRES)


def test_depth_alone_belongs_to_the_colour_image_of_its_name(tmp_path: Path) -> None:
    build.image(tmp_path / "x_color.png", build.color(0))
    np.savez(tmp_path / "x_depth.npz", depth=METRES)
    (source,) = find_frames(tmp_path)
    assert source.layout == "flat pairs"


def test_a_pickle_is_refused_with_the_command_that_converts_it(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", {"depth": METRES}, allow_pickle=True)
    np.save(tmp_path / "numbers.npy", METRES)
    (source,) = find_frames(tmp_path)
    with pytest.raises(FormatError, match=re.escape("a.npy --out DIR --trust-pickle")):
        source.read()


def test_arrays_next_to_a_pickle_of_the_same_name_are_read(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", {"depth": METRES}, allow_pickle=True)
    np.save(tmp_path / "b.npy", {"depth": METRES}, allow_pickle=True)
    np.savez(tmp_path / "a.npz", depth=METRES, K=build.K)
    assert [source.files[0].name for source in find_frames(tmp_path)] == ["a.npz", "b.npy"]


def test_pickled_members_of_an_npz_are_never_unpickled(tmp_path: Path) -> None:
    bad = np.array({"K": 1}, dtype=object)
    assert "pickles never" in refusal(tmp_path, depth=METRES, K=build.K, segmap=bad)


def test_a_damaged_archive_fails_alone_by_name_and_hides_no_images(tmp_path: Path) -> None:
    (tmp_path / "broken.npz").write_bytes(b"PK")
    with pytest.raises(FormatError, match="not a whole"):
        find_frames(tmp_path)[0].read()
    np.savez(tmp_path / "x.npz", depth=METRES, K=build.K)
    assert [source.name for source in find_frames(tmp_path)] == ["broken", "x"]
    (tmp_path / "x.npz").unlink()
    build.flat(tmp_path)
    assert [source.name for source in find_frames(tmp_path)] == ["0", "1"]


def test_trusted_pickles_of_one_name_are_two_frames(tmp_path: Path) -> None:
    content = {"depth": METRES, "K": build.K}
    np.save(tmp_path / "a.npy", content, allow_pickle=True)
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(content))
    sources = find_frames(tmp_path, FrameOptions(trust_pickles=True))
    assert [source.name for source in sources] == ["a", "a-2"]


def test_a_member_that_is_no_array_is_reported_in_one_sentence(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", K=build.K)
    with zipfile.ZipFile(tmp_path / "x.npz", "a") as archive:
        archive.writestr("depth", b"metres")
    with pytest.raises(FormatError, match="`depth` is no array"):
        find_frames(tmp_path)[0].read()


def test_depth_aligned_to_the_colour_is_preferred_to_raw_depth(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", depth=METRES + 1, aligned_depth=METRES, K=build.K)
    assert np.array_equal(find_frames(tmp_path)[0].read().depth, METRES)


def test_an_npz_with_other_keys_is_answered_with_the_keys_that_are_read(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", depth=METRES, picture=build.color(0), my_camera=build.K)
    with pytest.raises(SymgraspError, match="are named depth, K, and rgb"):
        find_frames(tmp_path)
