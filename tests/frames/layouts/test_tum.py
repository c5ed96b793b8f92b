"""TUM sequences: association by time, published calibrations, broken indices."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.cameras.camera_files import CameraFile
from pipelines.frames.frame_options import FrameOptions
from pipelines.frames.frames import find_frames
from pipelines.frames.layouts.tum import associate
from tests.frames.layouts import build

CAMERA = CameraFile(*build.FOUR)


def at(*times: float) -> list[tuple[float, Path]]:
    return [(time, Path(f"{time}")) for time in times]


def test_each_image_is_paired_once_with_the_nearest_in_time() -> None:
    pairs = associate(at(1.0, 1.015, 2.0), at(1.01, 1.04, 2.03))
    assert [(str(color), str(depth)) for color, depth in pairs] == [("1.015", "1.01")]
    assert associate(at(1.0), []) == []


def test_many_images_are_paired_in_order() -> None:
    times = [i / 30 for i in range(3000)]
    pairs = associate(at(*times), at(*[time + 0.004 for time in reversed(times)]))
    assert [color for color, _depth in pairs] == [Path(f"{time}") for time in times]


def test_images_of_one_time_are_paired_in_order_without_comparing_all() -> None:
    count = 20_000
    zero = [(0.0, number) for number in range(count)]
    assert associate(zero, zero[: count // 2]) == [(i, i) for i in range(count // 2)]


def test_each_time_takes_the_nearest_images_that_are_left() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        colors, depths = (
            [(time, i) for i, time in enumerate(np.round(rng.uniform(0, 0.1, 12), 2).tolist())]
            for _ in range(2)
        )
        assert associate(colors, depths) == naive_association(colors, depths)


def naive_association(colors, depths):
    """Pair all images by all gaps, one by one."""
    gaps = sorted((abs(d[0] - c[0]), c, d) for c in colors for d in depths)
    pairs = []
    for gap, color, depth in gaps:
        is_free = all(color != c and depth != d for c, d in pairs)
        if is_free and color[0] - 0.02 <= depth[0] <= color[0] + 0.02 and gap >= 0:
            pairs.append((color, depth))
    return [(color[1], depth[1]) for color, depth in sorted(pairs)]


def test_an_association_file_decides_on_pairs_in_either_order(tmp_path: Path) -> None:
    build.tum(tmp_path)
    colors, depths = (sorted((tmp_path / name).iterdir()) for name in ("rgb", "depth"))
    lines = [f"1.0 depth/{depths[1].name} 1.0 rgb/{colors[0].name}"]
    (tmp_path / "associations.txt").write_text("\n".join(lines))
    (source,) = find_frames(tmp_path, FrameOptions(CAMERA))
    assert source.files == (colors[0], depths[1])


def test_the_folders_name_selects_the_published_calibration(tmp_path: Path) -> None:
    folder = tmp_path / "rgbd_dataset_freiburg3_desk"
    folder.mkdir()
    build.tum(folder)
    with pytest.raises(SymgraspError, match="calibration of freiburg3: describes 640x480"):
        find_frames(folder)[0].read()


def test_the_nearest_folders_name_selects_the_calibration(tmp_path: Path) -> None:
    folder = tmp_path / "freiburg1/rgbd_dataset_freiburg3_desk"
    folder.mkdir(parents=True)
    build.tum(folder)
    with pytest.raises(SymgraspError, match="calibration of freiburg3"):
        find_frames(folder)[0].read()


@pytest.mark.parametrize(("name", "k1"), [("freiburg1", 0.2624), ("freiburg2", 0.2312)])
def test_the_published_distortion_is_removed(tmp_path: Path, name: str, k1: float) -> None:
    folder = tmp_path / f"rgbd_dataset_{name}_desk"
    folder.mkdir()
    build.tum(folder)
    for path in folder.glob("*/*.png"):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        large = cv2.resize(image, (640, 480), interpolation=cv2.INTER_NEAREST)
        assert cv2.imwrite(str(path), large)
    removed = find_frames(folder)[0].read().removed
    assert removed is not None
    assert removed.coefficients[0] == k1
    stated = FrameOptions(CameraFile(525.0, 525.0, 319.5, 239.5))
    assert find_frames(folder, stated)[0].read().removed is None


def test_a_sequence_without_a_camera_is_refused_with_the_option_for_it(tmp_path: Path) -> None:
    build.tum(tmp_path)
    with pytest.raises(FormatError, match="--intrinsics"):
        find_frames(tmp_path)[0].read()


@pytest.mark.parametrize("line", ["1.0", "yesterday rgb/1.png", "nan rgb/1.png", "1.0 a b c d"])
def test_a_broken_index_is_reported_in_one_sentence_and_stops_no_other_folder(
    tmp_path: Path, line: str
) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    build.tum(tmp_path / "a")
    build.flat(tmp_path / "b")
    (tmp_path / "a/rgb.txt").write_text(f"{line}\n")
    broken, *others = find_frames(tmp_path)
    assert broken.name == "a"
    with pytest.raises(FormatError, match=r"rgb\.txt"):
        broken.read()
    assert [source.read().name for source in others] == ["b/0", "b/1"]
