"""Features of points and their mirror images agree with their names, on a known box."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from pipelines.geometry.symmetry import ReflectionSymmetry
from pipelines.geometry.transforms import unit
from pipelines.grasping.scene import SceneCloud
from pipelines.grasping.symmetries.mirror_views import (
    NUM_POINTS,
    PLANE_FEATURES,
    POINT_FEATURES,
    MirrorImages,
    PlanePointFeature,
    plane_features,
    point_features,
)
from tests.grasping.symmetries.views import view_of_box

NORMAL = slice(PlanePointFeature.NORMAL_NORMAL, PlanePointFeature.NORMAL_ACROSS + 1)
DISTANCE, GAP = PlanePointFeature.IMAGE_DISTANCE, PlanePointFeature.IMAGE_GAP
AGREE, BEHIND = PlanePointFeature.IMAGE_AGREEMENT, PlanePointFeature.IMAGE_BEHIND
MEASURED, OWN = PlanePointFeature.IMAGE_IS_MEASURED, PlanePointFeature.IMAGE_IS_OWN
HEIGHT, IMAGE_HEIGHT = PlanePointFeature.HEIGHT, PlanePointFeature.IMAGE_HEIGHT


@pytest.fixture(scope="module")
def box():
    return view_of_box()


def planes_of(pose):
    turn = trimesh.transformations.rotation_matrix(0.6, [0, 0, 1])[:3, :3]
    return [ReflectionSymmetry(normal, [0, 0, 0]).transformed(pose) for normal in turn.T]


def rows_of(planes, view, scene=None):
    seen, region, _ = view
    shuffled = np.random.default_rng(0).permutation(len(region))[:400]
    points, normals = region.points[shuffled], region.normals[shuffled]
    images = MirrorImages.of(planes, points, normals)
    return point_features(planes, images, region.mask, scene or seen)


def test_shapes_are_as_documented(box):
    planes = planes_of(box[2])
    assert rows_of(planes, box).shape == (3, NUM_POINTS, len(POINT_FEATURES))
    assert plane_features(planes, box[1].points, box[0]).shape == (3, len(PLANE_FEATURES))


def test_features_do_not_depend_on_the_normals_sign(box):
    planes = planes_of(box[2])
    turned = [ReflectionSymmetry(-plane.normal, plane.point) for plane in planes]
    np.testing.assert_allclose(rows_of(turned, box), rows_of(planes, box), atol=1e-5)
    both = [plane_features(each, box[1].points, box[0]) for each in (planes, turned)]
    np.testing.assert_allclose(*both, atol=1e-6)


def test_a_true_plane_has_no_image_in_front_of_the_scene_or_beneath_the_table(box):
    rows = rows_of(planes_of(box[2]), box)
    assert (rows[..., BEHIND] > -20 * 0.004).mean() > 0.97
    assert rows[..., IMAGE_HEIGHT].min() > -5 * 0.004
    aside = [
        ReflectionSymmetry(plane.normal, plane.point + 0.02 * plane.normal)
        for plane in planes_of(box[2])
    ]
    moved = rows_of(aside, box)
    assert (moved[..., BEHIND] < -20 * 0.01).any() or moved[..., IMAGE_HEIGHT].min() < -5 * 0.03


def test_points_and_images_have_their_heights_above_the_table(box):
    # The heights of a point and its image add up to the height of the box, 12 cm.
    level = planes_of(box[2])[2]
    rows = rows_of([level], box)[0]
    np.testing.assert_allclose(rows[:, HEIGHT] + rows[:, IMAGE_HEIGHT], 5 * 0.12, atol=0.03)
    np.testing.assert_allclose(np.linalg.norm(rows[:, NORMAL], axis=1), 1.0, atol=1e-4)
    assert np.median(rows[:, 0]) > 0  # most of the surface is on the normal's side


def test_the_point_is_given_in_decimetres_from_the_plane(box):
    across = planes_of(box[2])[0]
    rows = rows_of([across], box)[0]
    assert np.abs(rows[:, 0]).max() == pytest.approx(0.25, abs=0.03)  # half of 5 cm


def test_an_image_on_the_seen_surface_is_near_it_with_its_normal(box):
    own = ReflectionSymmetry(box[1].normals[0], box[1].points[0])  # maps its face onto itself
    rows = rows_of([own], box)[0]
    on_face = np.abs(rows[:, 0]) < 0.02
    assert on_face.sum() > 5
    assert np.median(rows[on_face, DISTANCE]) < 30 * 0.004
    assert np.abs(rows[on_face, GAP]).max() < 50 * 0.005
    # Normals are mirrored; beyond an edge, the nearest point is on another face.
    assert (rows[on_face, AGREE] < -0.9).mean() > 0.8
    assert rows[on_face, MEASURED].mean() > 0.9
    assert rows[on_face, OWN].mean() > 0.9


def test_without_a_table_heights_are_zero(box):
    scene = SceneCloud(box[0].depth, box[0].intrinsics, None)
    rows = rows_of(planes_of(box[2]), box, scene)
    assert not rows[..., HEIGHT].any()
    assert not rows[..., IMAGE_HEIGHT].any()
    assert np.isfinite(rows).all()


def test_the_middle_is_half_way_between_the_ends_and_a_plane_at_an_end_is_all_of_it_off(box):
    points, normals = box[1].points[::3].copy(), box[1].normals[::3].copy()
    normal = unit([1.0, 2.0, 0.5])
    low, high = np.quantile(points @ normal, [0.015, 0.985])
    shares = np.array([0.5, 0.75, 1.0, 1.5])
    planes = [ReflectionSymmetry(normal, (low + a * (high - low)) * normal) for a in shares]
    off = MirrorImages.of(planes, points, normals).off_middle
    np.testing.assert_allclose(off, [0.0, 0.5, 1.0, 1.0], atol=1e-9)


@pytest.mark.parametrize("far", [False, True], ids=["near", "beside the picture"])
def test_rows_of_each_plane_equal_those_of_numpy_arrays(box, far):
    scene, region, pose = box
    up = scene.plane.normal
    planes = [*planes_of(pose), ReflectionSymmetry(unit([1.0, 2.0, 0.5]), [0.9 * far, 0.0, 0.7])]
    points, normals = region.points[:600:3].copy(), region.normals[:600:3].copy()
    seen = MirrorImages.of(planes, points, normals)
    rows = point_features(planes, seen, region.mask, scene)
    some = np.linspace(0, len(points) - 1, NUM_POINTS).round().astype(int)
    for plane, row, gap, sides in zip(planes, rows, seen.gap, seen.sides, strict=True):
        side = (points - plane.point) @ plane.normal
        np.testing.assert_allclose(np.quantile(side, [0.015, 0.5, 0.985]), sides, atol=1e-12)
        images = plane.counterpart(points[some])
        distance, nearest = KDTree(points).query(images)
        off = np.einsum("ni,ni->n", normals[nearest], images - points[nearest])
        np.testing.assert_allclose(gap, off, atol=1e-9)
        mirrored = plane.mirror_vectors(normals[some])
        agree = np.einsum("ni,ni->n", normals[nearest], mirrored)
        pixels, inside = scene.intrinsics.pixels_of(images)
        u, v = pixels.T * inside
        depth = np.where(inside, scene.depth[v, u], 0.0)
        behind = np.where(depth > 0, np.clip(images[:, 2] - depth, -0.05, 0.05), 0.0)
        front = plane.normal if np.median(side) >= 0 else -plane.normal
        along = up - up @ front * front
        ray = unit(points.mean(axis=0))
        along = unit(along if np.linalg.norm(along) >= 0.3 else ray - ray @ front * front)
        axes = np.stack([front, along, np.cross(front, along)])
        middle = points.mean(axis=0)
        foot = middle - (middle - plane.point) @ front * front
        expected = np.column_stack(
            [
                10.0 * (points[some] - foot) @ axes.T,
                normals[some] @ axes.T,
                0.9 * np.minimum(distance, 0.03) / 0.03,
                50.0 * np.clip(off, -0.02, 0.02),
                agree,
                20.0 * behind,
                depth > 0,
                inside & region.mask[v, u],
                5.0 * np.clip(scene.plane.height(points[some]), -0.1, 0.5),
                5.0 * np.clip(scene.plane.height(images), -0.1, 0.5),
            ]
        )
        np.testing.assert_allclose(row, expected, atol=2e-5)
