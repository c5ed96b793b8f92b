"""Several cameras in one ROS bag, and several images recorded at one time."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from pipelines.errors import FormatError
from pipelines.frames.encodings.ros_bags import Recorded
from pipelines.frames.encodings.ros_topics import Topics, cameras_of_topics
from pipelines.frames.frames import find_frames
from pipelines.frames.layouts.rosbag import frame_stems
from tests.frames.layouts import build
from tests.frames.layouts.test_rosbag import TOPICS, write_bag

pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
AZURE = {
    "color": "/rgb/image_raw",
    "depth": "/depth_to_rgb/image_raw",
    "info": "/depth_to_rgb/camera_info",
}


def below(name: str) -> dict[str, str]:
    return {kind: f"/{name}" + topic.removeprefix("/camera") for kind, topic in TOPICS.items()}


def is_frame(color: np.ndarray, depth: np.ndarray, index: int) -> None:
    assert_array_equal(color, build.color(index))
    assert np.abs(depth - build.depth(index) / np.float32(1000)).max() < 1e-6


@pytest.mark.parametrize("ros", [1, 2])
def test_images_recorded_at_the_same_time_give_one_frame_each(tmp_path: Path, ros: int) -> None:
    bag = tmp_path / ("a.bag" if ros == 1 else "a")
    write_bag(bag, ros=ros, recorded=lambda _seconds: 5 * 10**9)
    sources = find_frames(tmp_path)
    assert [source.name for source in sources] == [
        "a/00000001000000000000",
        "a/00000001000033333333",
    ]
    for i, source in enumerate(sources):
        frame = source.read()
        is_frame(frame.color, frame.depth, i)


def test_frames_are_named_by_their_times_of_recording_where_these_differ(tmp_path: Path) -> None:
    write_bag(tmp_path / "a")
    names = [source.name for source in find_frames(tmp_path)]
    assert names == ["a/00000001000000000500", "a/00000001000033333833"]


def test_all_images_have_different_names() -> None:
    one = Recorded(5, 7, 0)
    assert frame_stems([one]) == ["00000000000000000005"]
    # The second header states the time at which the third image was recorded.
    stems = frame_stems([one, Recorded(5, 9, 0), Recorded(9, 1, 0), Recorded(5, 7, 1)])
    assert len(set(stems)) == len(stems)
    assert stems[2] == "00000000000000000009"


def test_every_camera_of_a_bag_is_read_below_its_own_name(tmp_path: Path) -> None:
    write_bag(tmp_path / "a", topics=below("left"), more=(below("right"),))
    sources = find_frames(tmp_path)
    cameras = [source.name.rsplit("/", 1)[0] for source in sources]
    assert cameras == ["a/left"] * build.COUNT + ["a/right"] * build.COUNT
    for i, source in enumerate(sources):
        frame = source.read()
        turn = -1 if i >= build.COUNT else 1
        is_frame(frame.color[::turn], frame.depth[::turn], i % build.COUNT)
        assert frame.notes == ()


def test_a_camera_without_frames_fails_alone(tmp_path: Path) -> None:
    right = {kind: topic for kind, topic in below("right").items() if kind != "info"}
    write_bag(tmp_path / "a", topics=below("left"), more=(right,))
    left, right_one = find_frames(tmp_path)[:: build.COUNT]
    left.read()
    with pytest.raises(FormatError, match="has no CameraInfo next to /right/"):
        right_one.read()


def test_azure_kinects_aligned_depth_is_known(tmp_path: Path) -> None:
    raw = {"depth": "/depth/image_raw", "info": "/depth/camera_info"}
    write_bag(tmp_path / "a", topics=AZURE, more=(raw,))
    sources = find_frames(tmp_path)
    assert len(sources) == build.COUNT
    frame = sources[0].read()
    is_frame(frame.color, frame.depth, 0)
    assert frame.notes == ()


def test_colour_aligned_to_the_depth_camera_is_not_taken_for_depth_aligned_to_colour(
    tmp_path: Path,
) -> None:
    other = {"color": "/rgb_to_depth/image_raw", "depth": "/depth/image_raw"}
    write_bag(tmp_path / "a", topics=AZURE, more=(other | {"info": "/depth/camera_info"},))
    frame = find_frames(tmp_path)[0].read()
    is_frame(frame.color, frame.depth, 0)
    assert frame.notes == ()


def test_a_second_colour_that_fits_as_well_gives_a_note(tmp_path: Path) -> None:
    topics = below("camera") | {"depth": "/camera/aligned_depth/image_raw"}
    write_bag(tmp_path / "a", topics=topics, more=({"color": "/camera/rgb/image_raw"},))
    (note,) = find_frames(tmp_path)[0].read().notes
    assert note == (
        "colour is read from /camera/color/image_raw; /camera/rgb/image_raw may belong to "
        "/camera/aligned_depth/image_raw as well"
    )


def test_a_camera_whose_depth_is_not_aligned_gives_a_warning(tmp_path: Path) -> None:
    raw = below("right") | {"depth": "/right/depth/image_rect_raw"}
    write_bag(tmp_path / "a", topics=below("left"), more=(raw,))
    sources = find_frames(tmp_path)
    assert len(sources) == build.COUNT
    (note,) = sources[0].read().notes
    assert note == "/right/depth/image_rect_raw is passed over: it is not called aligned"


def test_a_camera_whose_topics_do_not_identify_it_gives_a_warning(tmp_path: Path) -> None:
    one, other = (
        {kind: f"/{kind}_aligned_{side}" for kind in ("color", "depth")} for side in ("l", "r")
    )
    write_bag(tmp_path / "a", topics=one | {"info": "/camera_info"}, more=(other,))
    (note,) = find_frames(tmp_path)[0].read().notes
    assert "passed over: by the topics' names" in note


@pytest.mark.parametrize(
    ("colors", "depths", "expected"),
    [
        # A driver's many topics of one camera.
        (["/c/color"], ["/c/aligned_depth_to_color", "/c/aligned_depth_to_infra1", "/c/depth"],
         [("/c/color", "/c/aligned_depth_to_color")]),
        # /a's colour was not recorded: its depth is not taken for /b's.
        (["/b/color"], ["/a/aligned_depth", "/b/aligned_depth"],
         [("/b/color", "/b/aligned_depth")]),
    ],
)  # fmt: skip
def test_topics_of_one_camera_share_their_first_words(
    colors: list[str], depths: list[str], expected: list[tuple[str, str]]
) -> None:
    assert cameras_of_topics(colors, depths, {}) == [Topics(*each) for each in expected]
