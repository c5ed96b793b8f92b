"""Overlays hold the stamp of the run whose grasps they show, and stay normal PNG files."""

import zlib
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pipelines.frames.rgbd import Frame
from pipelines.geometry.camera import Intrinsics
from pipelines.grasp_files.grasps_tables import FrameResult, GraspTable, RegionTable
from pipelines.pictures.overlays import draw_overlay, is_drawn, write_overlay
from pipelines.pictures.palette import AXIS_COLOR, CONTACT_COLOR, PLANE_COLORS, region_color, rgb
from pipelines.storage.images import read_image
from pipelines.storage.provenance import make_stamp
from tests.pictures.grasp_page.toys import toy_frame, toy_result

FRAME, INDEX = toy_frame()
RESULT = toy_result(FRAME, INDEX)
STAMP = make_stamp("infer", {"gripper": "rg2"}, seed=3, inputs={"é": "sha256:1"})
COLOR_OF_SLOT = (*PLANE_COLORS, AXIS_COLOR, AXIS_COLOR)
BALL_CAMERA = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)


def enlarged(factor: int, slot: int) -> tuple[Frame, FrameResult]:
    """The frame at `factor` times its size, in grey, and its first region with a symmetry."""

    def large(pixels: np.ndarray) -> np.ndarray:
        return np.repeat(np.repeat(pixels, factor, 0), factor, 1)

    camera = FRAME.intrinsics.resized(*(factor * size for size in RESULT.size))
    regions = RegionTable.from_masks(
        [large(INDEX == 0)],
        confidence=[0.9],
        source=["detector"],
        symmetry_confidence=np.eye(5)[[slot]],
        symmetry_point=RESULT.regions.symmetry_point[:1],
        symmetry_direction=RESULT.regions.symmetry_direction[:1],
        affordance_mean=[0],
        affordance_max=[0],
    )
    depth = large(FRAME.depth)
    frame = Frame("large", np.full((*depth.shape, 3), 120, np.uint8), depth, camera)
    return frame, FrameResult("large", "ok", "", camera, 0.0, regions, GraspTable.empty())


def drawn_ball(distance: float, radius: float, hidden: float) -> tuple[np.ndarray, np.ndarray]:
    """The overlay of a ball whose left part of `hidden`, 0..1, is no region; and its mask (H, W).

    `distance` of the ball's centre ahead of the camera and its `radius` in metres.
    """
    rays = BALL_CAMERA.rays()
    along, square = distance * rays[..., 2], (rays**2).sum(-1)
    inside = along**2 - square * (distance**2 - radius**2)
    ball = inside > 0
    depth = np.where(ball, (along - np.sqrt(np.maximum(inside, 0))) / square, 1.0)
    columns = np.flatnonzero(ball.any(axis=0))
    first = columns[0] + hidden * len(columns)
    mask = ball & (np.arange(BALL_CAMERA.width) >= first)
    point = np.full((1, 5, 3), np.nan)
    point[0, 4] = 0, 0, distance
    regions = RegionTable.from_masks(
        [mask],
        confidence=[0.9],
        source=["detector"],
        symmetry_confidence=[[0, 0, 0, 0, 0.9]],
        symmetry_point=point,
        symmetry_direction=np.full((1, 5, 3), np.nan),
        affordance_mean=[0],
        affordance_max=[0],
    )
    frame = Frame("ball", np.full((*depth.shape, 3), 120, np.uint8), depth, BALL_CAMERA)
    result = FrameResult("ball", "ok", "", BALL_CAMERA, 0.0, regions, GraspTable.empty())
    return draw_overlay(frame, result), ball


@pytest.fixture
def picture(tmp_path):
    write_overlay(tmp_path / "a.png", FRAME, RESULT, STAMP)
    return tmp_path / "a.png"


def chunks_of(data: bytes) -> list[tuple[bytes, bytes]]:
    """Return the kinds and contents of a PNG's chunks, after verifying their check sums."""
    place, found = 8, []
    while place < len(data):
        size = int.from_bytes(data[place : place + 4], "big")
        kind, content = data[place + 4 : place + 8], data[place + 8 : place + 8 + size]
        check = int.from_bytes(data[place + 8 + size : place + 12 + size], "big")
        assert check == zlib.crc32(kind + content)
        found.append((kind, content))
        place += 12 + size
    return found


def test_the_file_holds_the_drawn_picture_with_a_text_after_its_header(picture):
    np.testing.assert_array_equal(read_image(picture), draw_overlay(FRAME, RESULT))
    chunks = chunks_of(picture.read_bytes())
    assert [kind for kind, _ in chunks[:2]] == [b"IHDR", b"tEXt"]
    assert chunks[1][1] == b"provenance\0" + STAMP.as_text().encode("latin-1")
    assert chunks[-1][0] == b"IEND"


def test_a_grasp_that_is_not_worth_trying_is_drawn_faintly():
    weak = replace(RESULT.grasps, worth_trying=np.zeros(len(RESULT.grasps), bool))
    bare = draw_overlay(FRAME, replace(RESULT, grasps=type(weak).empty()))
    marked = [
        int((draw_overlay(FRAME, replace(RESULT, grasps=table)) != bare).any(axis=-1).sum())
        for table in (weak, RESULT.grasps)
    ]
    assert 0 < marked[0] < 0.7 * marked[1]


def numbered(
    columns: list[int],
    shown: list[int],
    width: int,
    part: tuple[int, int, int, int] | None = None,
    final: int | None = None,
) -> np.ndarray:
    """The overlay (H, W, 3) of narrow regions at `columns`; the masks not in `shown` are empty."""
    camera = Intrinsics(600.0, 600.0, width / 2, width / 4, width, width // 2)
    place = np.arange(width)
    masks = np.zeros((len(columns), camera.height, width), bool)
    for region in shown:
        masks[region, camera.height // 2 :] = np.abs(place - columns[region]) <= 2
    regions = RegionTable.from_masks(
        list(masks),
        confidence=np.ones(len(columns)),
        source=["detector"] * len(columns),
        status=["no_depth"] * len(columns),
        symmetry_confidence=np.zeros((len(columns), 5)),
        symmetry_point=np.full((len(columns), 5, 3), np.nan),
        symmetry_direction=np.full((len(columns), 5, 3), np.nan),
        affordance_mean=np.zeros(len(columns)),
        affordance_max=np.zeros(len(columns)),
    )
    frame = Frame("row", np.full((*masks.shape[1:], 3), 120, np.uint8), masks[0] * 0.0, camera)
    result = FrameResult("row", "ok", "", camera, 0.0, regions)
    return draw_overlay(frame, result, part, final)


@pytest.mark.parametrize("columns", [[300, 310, 320, 330], [2, 9, 630, 637]])
def test_labels_of_neighboring_regions_do_not_hide_each_other(columns):
    regions = list(range(len(columns)))
    together = numbered(columns, regions, 640)
    for region in regions:
        color = rgb(region_color(region))
        alone = numbered(columns, [region], 640)
        ink, left = ((picture == color).all(axis=-1).sum() for picture in (alone, together))
        assert left >= 0.98 * ink


@pytest.mark.parametrize("width", [64, 160, 320, 640, 1280])
def test_digits_of_labels_are_large_enough_to_be_told_apart(width):
    picture = numbered([width // 2], [0], width)[: width // 4]  # above the region
    rows, columns = np.nonzero((picture == rgb(region_color(0))).all(axis=-1))
    assert np.ptp(rows) >= max(7, width / 100)
    assert columns.min() <= 0.5 * width


def test_a_part_of_a_frame_is_drawn_at_its_final_size():
    """Contacts are where the camera sees them; lines and labels are those of a whole picture."""
    part, width = (90, 70, 250, 190), 960
    picture = draw_overlay(FRAME, RESULT, part, width)
    assert picture.shape == (720, 960, 3)
    grasps = RESULT.grasps
    contacts = FRAME.intrinsics.project(grasps.contacts[grasps.is_best]).reshape(-1, 2)
    places = (contacts - part[:2] + 0.5) * 6 - 0.5
    u, v = np.round(places[((places > 0) & (places < (960, 720))).all(axis=1)]).astype(int).T
    assert len(u) > 1
    assert (picture[v, u] == rgb(CONTACT_COLOR)).all(axis=-1).mean() >= 0.5  # others have a label
    grey, result = enlarged(2, 3)
    red = (draw_overlay(grey, result, (160, 120, 480, 360), 640) == rgb(AXIS_COLOR)).all(axis=-1)
    assert red.any(axis=0).sum() > 20
    assert np.median(red.sum(axis=0)[red.any(axis=0)]) <= 3  # the axis is level


def test_regions_outside_of_the_part_have_no_label():
    columns = [100, 500]
    camera_sees = numbered(columns, [0, 1], 640, (0, 0, 320, 320), 640)
    assert (camera_sees == rgb(region_color(0))).all(axis=-1).any()
    assert not (camera_sees == rgb(region_color(1))).all(axis=-1).any()


def test_a_labels_halo_is_on_all_sides_of_its_letters():
    picture = numbered([640], [0], 1280)[:320]  # above the region
    dark, ink = (picture == 0).all(axis=-1), (picture == rgb(region_color(0))).all(axis=-1)
    columns = [np.flatnonzero(layer.any(axis=0)) for layer in (dark, ink)]
    assert 1 <= columns[1][0] - columns[0][0] <= 3
    assert 1 <= columns[0][-1] - columns[1][-1] <= 3


def test_a_label_without_a_free_place_is_written_all_the_same():
    regions = list(range(60))
    picture = numbered([320] * 60, regions, 640)[:150]  # above the regions
    assert (picture == rgb(region_color(59))).all(axis=-1).any()


@pytest.mark.parametrize("slot", [0, 3, 4])
def test_symmetries_cover_the_same_part_of_small_and_large_pictures(slot):
    parts = []
    for factor in (2, 8):
        drawn = draw_overlay(*enlarged(factor, slot)).astype(int)
        parts.append((np.abs(drawn - rgb(COLOR_OF_SLOT[slot])).max(axis=-1) < 60).mean())
    assert parts[0] > 1e-4
    assert parts[1] == pytest.approx(parts[0], rel=0.3)


def test_only_points_of_regions_are_computed_for_their_symmetries(monkeypatch):
    monkeypatch.setattr(Intrinsics, "backproject", None)
    assert (draw_overlay(FRAME, RESULT) != FRAME.color).any()


@pytest.mark.parametrize(("distance", "hidden"), [(0.5, 0.0), (0.2, 0.0), (0.5, 0.5), (0.5, 0.7)])
def test_the_ring_of_a_sphere_is_the_outline_of_the_ball_even_if_near_or_partly_hidden(
    distance, hidden
):
    picture, ball = drawn_ball(distance, 0.04, hidden)
    red = np.abs(picture.astype(int) - rgb(AXIS_COLOR)).max(axis=-1) < 60
    v, u = np.nonzero(red)
    ring = np.median(np.hypot(u - BALL_CAMERA.cx, v - BALL_CAMERA.cy))
    assert len(u) > 100
    assert abs(ring - np.sqrt(ball.sum() / np.pi)) < 1.0


def test_a_ball_that_reaches_behind_the_camera_has_no_ring():
    for radius in (0.1999999, 0.2, 0.21):
        picture, _ = drawn_ball(0.2, radius, 0.0)
        assert not (np.abs(picture.astype(int) - rgb(AXIS_COLOR)).max(axis=-1) < 60).any()


def test_the_same_result_gives_the_same_bytes(picture):
    again = picture.with_name("b.png")
    write_overlay(again, FRAME, RESULT, STAMP)
    assert again.read_bytes() == picture.read_bytes()


def test_a_picture_is_recognised_by_its_own_stamp_only(picture):
    assert is_drawn(picture, STAMP)
    for change in ({"seed": 4}, {"config": {"gripper": "franka"}}, {"inputs": {}}):
        assert not is_drawn(picture, replace(STAMP, **change))


def test_other_and_damaged_files_are_not_taken_for_our_pictures(picture, tmp_path):
    data = picture.read_bytes()
    for size in (0, 20, 40, 60):
        picture.write_bytes(data[:size])
        assert not is_drawn(picture, STAMP)
    cv2.imwrite(str(picture), FRAME.color)
    assert not is_drawn(picture, STAMP)
    assert not is_drawn(tmp_path, STAMP)
    assert not is_drawn(tmp_path / "none.png", STAMP)
