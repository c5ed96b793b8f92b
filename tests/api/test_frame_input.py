"""Input of a caller: the accepted kinds, and an error sentence for every other kind."""

from array import array
from enum import IntEnum

import numpy as np
import pytest
import torch

from pipelines.errors import SymgraspError, UnknownNameError
from pipelines.frames.cameras.lens import BROWN, FISHEYE, Distortion
from pipelines.geometry.camera import Intrinsics
from pipelines.inference.models import WEIGHTS
from pipelines.storage.files import read_json
from pipelines.storage.images import read_image
from symgrasp import bundled_frame
from symgrasp.frame_input import frame_of, instance_masks, workspace_of

FRAMES = WEIGHTS / "frames"
SHAPE = (48, 64)
COLOR = np.full((*SHAPE, 3), 90, np.uint8)
DEPTH = np.full(SHAPE, 0.8)
LENS = (60.0, 61.0, 32.0, 24.0)
MATRIX = np.array([[60.0, 0, 32], [0, 61, 24], [0, 0, 1]])


@pytest.mark.parametrize(
    "intrinsics",
    [
        LENS,
        list(LENS),
        np.array(LENS),
        MATRIX,
        MATRIX.tolist(),
        Intrinsics(*LENS, 64, 48),
        {"fx": 60.0, "fy": 61.0, "cx": 32.0, "cy": 24.0},
        {"K": MATRIX.ravel().tolist(), "width": 64, "height": 48},
        {"fx": 60.0, "fy": 61.0, "cx": 32.0, "cy": 24.0, None: "no name"},
        MATRIX.ravel(),
        MATRIX.ravel().tolist(),
    ],
)
def test_intrinsics_are_four_numbers_a_matrix_or_named(intrinsics):
    assert frame_of(COLOR, DEPTH, intrinsics).intrinsics == Intrinsics(*LENS, 64, 48)


@pytest.mark.parametrize(
    ("depth", "units"),
    [
        (DEPTH, None),
        (DEPTH.astype(np.float32), None),
        ((DEPTH * 1000).astype(np.uint16), None),
        ((DEPTH * 1000).astype(np.uint16), 1000),
        ((DEPTH * 10000).astype(np.uint16), 10000),
        (DEPTH * 1000, 1000.0),
        ((DEPTH * 1000).astype(np.int32), None),
    ],
)
def test_depth_is_floats_in_metres_or_whole_numbers_in_millimetres_or_a_stated_unit(depth, units):
    read = frame_of(COLOR, depth, LENS, units).depth
    assert read.dtype == np.float32
    np.testing.assert_allclose(read, 0.8, atol=1e-6)


class LensModel:
    """A model as librealsense has it: an enum of its own, whose text is the name."""

    def __str__(self):
        return "distortion.kannala_brandt4"


class Model(IntEnum):
    KANNALA_BRANDT4 = 4


COEFFICIENTS = [0.1, -0.02, 0.01, -0.002]


@pytest.mark.parametrize(
    ("changed", "model"),
    [
        ({"D": np.array(COEFFICIENTS)}, BROWN),
        ({"D": np.array([COEFFICIENTS])}, BROWN),  # of OpenCV's calibrateCamera
        ({"D": tuple(COEFFICIENTS)}, BROWN),
        ({"d": array("d", COEFFICIENTS)}, BROWN),  # of rclpy's CameraInfo
        ({"coeffs": torch.tensor(COEFFICIENTS, dtype=torch.float64)}, BROWN),
        ({"k1": np.float64(0.1), "k2": -0.02, "p1": 0.01, "p2": np.float64(-0.002)}, BROWN),
        ({"distortion": {"coefficients": np.array(COEFFICIENTS)}}, BROWN),
        ({"coeffs": COEFFICIENTS, "model": LensModel()}, FISHEYE),
        ({"coeffs": COEFFICIENTS, "model": Model.KANNALA_BRANDT4}, FISHEYE),
    ],
)
def test_lens_distortion_in_a_mapping_may_have_any_type_of_list_and_of_name(changed, model):
    given = {"K": MATRIX, "width": np.int64(64), "height": 48} | changed
    frame = frame_of(COLOR, DEPTH, given)
    assert frame.removed == Distortion(model, tuple(COEFFICIENTS))


def test_a_bundled_frame_holds_the_content_of_its_files():
    files = FRAMES / "table_3_color.png", FRAMES / "table_3_depth.png"
    color, depth = (read_image(path) for path in files)
    camera = read_json(FRAMES / "table_3_camera.json")
    one, other = frame_of(color, depth, camera), frame_of(*bundled_frame("table_3"))
    np.testing.assert_array_equal(one.color, other.color)
    np.testing.assert_array_equal(one.depth, other.depth)
    assert one.intrinsics == other.intrinsics
    with pytest.raises(UnknownNameError, match="table_1, table_2, table_3, table_4"):
        bundled_frame("table")


def test_the_unit_of_a_camera_file_holds_for_whole_numbers():
    named = dict(zip(("fx", "fy", "cx", "cy"), LENS, strict=True)) | {"depth_scale": 5000}
    read = frame_of(COLOR, (DEPTH * 5000).astype(np.uint16), named).depth
    np.testing.assert_allclose(read, 0.8, atol=1e-6)
    np.testing.assert_allclose(frame_of(COLOR, DEPTH, named).depth, 0.8, atol=1e-6)


def test_pixels_without_a_valid_distance_are_missing_and_the_callers_array_does_not_change():
    depth = DEPTH.copy()
    depth[0, :4] = np.nan, np.inf, -1.0, 0.0
    before = depth.copy()
    read = frame_of(COLOR, depth, LENS).depth
    assert read[0, :5].tolist() == pytest.approx([0, 0, 0, 0, 0.8])
    np.testing.assert_array_equal(depth, before)


def test_depth_in_columns_is_read_in_rows_for_which_the_loops_are_compiled():
    for depth in (np.asfortranarray(DEPTH), np.rot90(np.rot90(DEPTH, 3).copy())):
        assert frame_of(COLOR, depth, LENS).depth.flags.c_contiguous


def test_masked_pixels_of_a_masked_array_are_missing():
    depth = np.ma.masked_array(DEPTH, np.arange(64) < np.full(SHAPE, 2))
    read = frame_of(COLOR, depth, LENS).depth
    assert read[5, :3].tolist() == pytest.approx([0, 0, 0.8])


def test_a_tensor_with_a_gradient_is_refused_in_one_sentence():
    depth = torch.from_numpy(DEPTH).requires_grad_()
    with pytest.raises(SymgraspError, match=r"depth is no array \(.*detach.* numpy accepts"):
        frame_of(COLOR, depth, LENS)
    np.testing.assert_allclose(frame_of(COLOR, depth.detach(), LENS).depth, 0.8, atol=1e-6)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"color": COLOR / 255.0}, r"color is an array \(48, 64, 3\) of float64; .* uint8"),
        (
            {"color": COLOR[..., 0]},
            r"color is an array \(48, 64\) of uint8; .*width, 3\)",
        ),
        ({"color": np.dstack([COLOR, COLOR])[..., :4]}, r"color is an array \(48, 64, 4\)"),
        ({"color": None}, "color is None"),
        ({"color": COLOR[::2]}, "size of color is 64x24; it must be 64x48 as the depth"),
        ({"depth": DEPTH[::2, ::2]}, "size of color is 64x48; it must be 32x24"),
        ({"depth": DEPTH * 1000}, "nearest depths are about 800 m.*depth_units_per_metre: .* 1000"),
        ({"depth": DEPTH / 100}, "nearest depths are about 0.008 m"),
        ({"depth": DEPTH[..., None]}, r"depth is an array \(48, 64, 1\)"),
        ({"depth": DEPTH > 0}, r"depth is an array \(48, 64\) of bool"),
        ({"depth": np.full(SHAPE, 80, np.uint8)}, r"depth is an array \(48, 64\) of uint8"),
        ({"depth": np.zeros((0, 0))}, r"depth is an array \(0, 0\)"),
        ({"depth": np.full(SHAPE, np.nan)}, "depth: every pixel is missing"),
        ({"depth": [[1.0, 2.0], [3.0]]}, "depth is no array"),
        ({"intrinsics": None}, "intrinsics is None; it must be fx, fy, cx, cy"),
        ({"intrinsics": LENS[:3]}, r"intrinsics is an array \(3,\).* mapping with the keys"),
        ({"intrinsics": "60,61,32,24"}, "intrinsics is '60,61,32,24'; it must be fx, fy"),
        ({"intrinsics": (60.0, np.nan, 32.0, 24.0)}, "intrinsics: fy is nan; it must be positive"),
        ({"intrinsics": (60.0, 32.0, 61.0, 24.0)}, r"intrinsics: has its principal point at \(61"),
        ({"intrinsics": (1.9, 1.9, 32.0, 24.0)}, None),
        ({"intrinsics": (0.6, 0.6, 32.0, 24.0)}, "intrinsics: has focal lengths of 0.6 and 0.6"),
        ({"intrinsics": MATRIX.T}, "intrinsics: "),
        ({"intrinsics": np.zeros((3, 3))}, "intrinsics: "),
        ({"intrinsics": {"fx": 60.0}}, "intrinsics: lacks fy, cx, cy"),
        ({"intrinsics": Intrinsics(*LENS, 640, 480)}, "intrinsics: describes 640x480 images"),
        ({"units": 0.0}, "depth_units_per_metre is 0.0"),
        ({"units": np.nan}, "depth_units_per_metre is nan"),
        ({"units": True}, "depth_units_per_metre is True"),
    ],
)
def test_arrays_that_make_no_frame_are_refused_in_one_sentence(changed, sentence):
    given = {"color": COLOR, "depth": DEPTH, "intrinsics": LENS} | changed
    if sentence is None:
        frame_of(**given)
        return
    with pytest.raises(SymgraspError, match=sentence) as error:
        frame_of(**given)
    assert "\n" not in str(error.value)


def test_masks_are_ids_or_one_mask_or_a_stack_whose_first_mask_takes_shared_pixels():
    ids = np.zeros(SHAPE, np.uint8)
    ids[:4], ids[9:12] = 3, 9
    np.testing.assert_array_equal(instance_masks(ids, SHAPE).labels, ids)
    assert instance_masks(ids, SHAPE).first == 1
    np.testing.assert_array_equal(instance_masks(ids > 0, SHAPE).labels, ids > 0)
    stacked = instance_masks([ids == 9, ids > 0], SHAPE)
    np.testing.assert_array_equal(stacked.labels, np.select([ids == 9, ids > 0], [1, 2]))
    assert stacked.first == 0
    assert instance_masks(None, SHAPE) is None
    for none in ([], np.zeros((0, *SHAPE), bool)):
        assert not instance_masks(none, SHAPE).labels.any()


@pytest.mark.parametrize(
    ("masks", "sentence"),
    [
        (np.ones((10, 20), bool), r"masks is an array \(10, 20\) of bool; .*\(48, 64\)"),
        (np.ones((*SHAPE, 2), bool), r"masks is an array \(48, 64, 2\) .* \(n, 48, 64\) of bool"),
        (np.ones((2, 10, 20), bool), r"masks is an array \(2, 10, 20\)"),
        (np.ones((1, 1, *SHAPE), bool), r"masks is an array \(1, 1, 48, 64\)"),
        (np.ones((2, *SHAPE), np.uint8), r"masks is an array \(2, 48, 64\) of uint8; .* bool"),
        (np.ones(SHAPE), "masks is an array .* of float64; .* whole numbers"),
        (np.full(SHAPE, -1), "masks is between -1 and -1"),
        (np.full(SHAPE, 2**40), "masks is between"),
        ([np.ones(SHAPE, bool), np.ones((2, 2), bool)], "masks is no array"),
    ],
)
def test_masks_of_wrong_shape_or_type_are_refused_in_one_sentence(masks, sentence):
    with pytest.raises(SymgraspError, match=sentence):
        instance_masks(masks, SHAPE)


def test_a_workspace_is_a_mask_or_a_box():
    mask, box = workspace_of(DEPTH > 0, SHAPE)
    assert mask.all()
    assert box == ()
    low_high = [[-0.3, -0.2, 0.4], [0.3, 0.2, 1]]
    assert workspace_of(low_high, SHAPE) == (None, (-0.3, -0.2, 0.4, 0.3, 0.2, 1.0))
    assert workspace_of(np.ravel(low_high), SHAPE)[1] == (-0.3, -0.2, 0.4, 0.3, 0.2, 1.0)
    assert workspace_of(None, SHAPE) == (None, ())


@pytest.mark.parametrize(
    ("workspace", "sentence"),
    [
        (np.ones((10, 20), bool), r"workspace is an array \(10, 20\) of bool"),
        (np.ones(SHAPE, np.uint8), r"workspace is an array \(48, 64\) of uint8; .*bool mask"),
        ((0, 0, 0, 1, 1), r"workspace is an array \(5,\)"),
        ([[0, 1], [0, 1], [0, 1]], r"workspace is an array \(3, 2\)"),  # limits of each axis
        ([[[0, 0, 0, 1, 1, 1]]], r"workspace is an array \(1, 1, 6\)"),
        ((0, 0, 0, 1, -1, 1), r"workspace is \[0.0, .*each minimum below its maximum"),
        ((0, 0, 0, 1, np.nan, 1), "workspace is"),
        ("left", "workspace is 'left'"),
    ],
)
def test_a_workspace_of_wrong_shape_or_type_is_refused_in_one_sentence(workspace, sentence):
    with pytest.raises(SymgraspError, match=sentence):
        workspace_of(workspace, SHAPE)
