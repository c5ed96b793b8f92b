"""A page's points equal the frame's within half a step of depth."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from pipelines.frames.rgbd import Frame
from pipelines.geometry.camera import Intrinsics
from pipelines.grasp_files.grasps_tables import FrameResult, RegionTable
from pipelines.pictures.grasp_page.cloud import FINEST_STEP, STEPS, PixelCloud, label_image


def random_frame(seed: int, width: int, height: int, far: float) -> Frame:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(1e-5, far, (height, width)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.3] = 0.0
    color = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    camera = Intrinsics(1.1 * width, 1.2 * width, 0.47 * width, 0.55 * height, width, height)
    return Frame("a", color, depth, camera)


def empty_result(frame: Frame) -> FrameResult:
    return FrameResult("a", "empty", "", frame.intrinsics)


@given(
    st.integers(0, 1000),
    st.integers(1, 90),
    st.integers(1, 70),
    st.floats(0.3, 60.0),
    st.integers(1, 4000),
)
def test_every_kept_pixel_keeps_its_point_to_half_a_step(seed, width, height, far, most):
    frame = random_frame(seed, width, height, far)
    cloud = PixelCloud.of(frame, empty_result(frame), most)
    assert cloud.depth.size <= most
    assert cloud.step >= FINEST_STEP
    thin = frame.depth[:: cloud.stride, :: cloud.stride].astype(float)
    stored = cloud.depth * cloud.step
    assert_array_equal(cloud.depth == 0, thin == 0)
    # A distance below half a step is not rounded to zero, which would mean missing.
    allowed = np.where(thin < cloud.step / 2, cloud.step, 0.5 * cloud.step)
    assert (np.abs(stored - thin)[thin > 0] <= (allowed * (1 + 1e-6) + 1e-9)[thin > 0]).all()
    assert_array_equal(cloud.color, frame.color[:: cloud.stride, :: cloud.stride])
    exact = frame.intrinsics.backproject(frame.depth)[:: cloud.stride, :: cloud.stride]
    ray = np.abs(exact) / exact[..., 2:]
    error = np.abs(cloud.points() - exact)
    assert np.nanmax(error - ray * allowed[..., None] * (1 + 1e-6), initial=0.0) < 1e-9


def test_the_farthest_depth_is_not_clipped():
    depth = np.array([[0.5, 17.0]], np.float32)
    color = np.zeros((1, 2, 3), np.uint8)
    frame = Frame("a", color, depth, Intrinsics(2, 2, 1, 0.5, 2, 1))
    cloud = PixelCloud.of(frame, empty_result(frame), 10)
    assert cloud.depth.max() == STEPS
    assert np.abs(cloud.depth * cloud.step - depth).max() < 17.0 / STEPS


def test_the_smaller_of_overlapping_regions_is_shown():
    masks = [np.zeros((4, 6), bool) for _ in range(2)]
    masks[0][1:3, 1:3], masks[1][:, :5] = True, True
    nothing = np.full((2, 5, 3), np.nan)
    regions = RegionTable.from_masks(
        masks,
        confidence=[1, 1],
        source=["masks"] * 2,
        symmetry_confidence=np.zeros((2, 5)),
        symmetry_point=nothing,
        symmetry_direction=nothing,
        affordance_mean=[0, 0],
        affordance_max=[0, 0],
    )
    camera = Intrinsics(5, 5, 3, 2, 6, 4)
    labels = label_image(FrameResult("a", "empty", "", camera, 0.0, regions))
    assert (labels[masks[0]] == 1).all()
    assert (labels[masks[1] & ~masks[0]] == 2).all()
    assert (labels[:, 5] == 0).all()
