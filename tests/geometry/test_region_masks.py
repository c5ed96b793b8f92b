"""Masks of the regions of posed objects."""

import numpy as np
from numpy.testing import assert_allclose

from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.region_masks import RegionedObject, visible_regions
from pipelines.geometry.rendering import Scene, cast_view
from pipelines.geometry.symmetry import ObjectRegion, ReflectionSymmetry
from pipelines.geometry.transforms import make_pose, random_rotation, transform_points
from tests.geometry.symmetric_shapes import ball_beside_box, box

CAMERA = Intrinsics(200.0, 200.0, 79.5, 59.5, 160, 120)
PLANE = ReflectionSymmetry(np.array([1.0, 0.0, 0.0]), np.zeros(3))


def posed_box(rng):
    return make_pose(random_rotation(rng), np.array([0.02, 0.01, 0.5]))


def halves(mesh):
    """Two regions: the triangles whose normals point along +x, and the others."""
    right = mesh.face_normals[:, 0] > 0.5
    return RegionedObject(
        mesh,
        (
            ObjectRegion("right", np.flatnonzero(right), (PLANE,)),
            ObjectRegion("other", np.flatnonzero(~right), ()),
        ),
    )


def whole(mesh):
    return RegionedObject(mesh, (ObjectRegion("whole", np.arange(len(mesh.faces)), (PLANE,)),))


def label_of(mesh, pose):
    return cast_view(Scene([mesh], [pose]), CAMERA, np.eye(4)).object_index + 1


def test_the_masks_of_all_regions_are_the_object_and_do_not_overlap():
    mesh, rng = box(), np.random.default_rng(0)
    for pose in (posed_box(rng) for _ in range(5)):
        label = label_of(mesh, pose)
        found = visible_regions(label, CAMERA, [(0, pose)], {0: halves(mesh)})
        count = np.sum([region.mask for region in found], axis=0)
        assert_allclose(count, label == 1)


def test_a_pixel_belongs_to_the_region_of_the_triangle_it_shows():
    mesh, rng, regioned, seen = box(), np.random.default_rng(4), halves(box()), set()
    names = np.array(["right", "other"])
    for pose in (posed_box(rng) for _ in range(5)):
        hits = cast_view(Scene([mesh], [pose]), CAMERA, np.eye(4))
        for region in visible_regions(hits.object_index + 1, CAMERA, [(0, pose)], {0: regioned}):
            shown = names[regioned.region_of_triangle[hits.triangle_index[region.mask]]]
            assert (shown == region.name).all()
            seen.add(region.name)
    assert seen == {"right", "other"}


def test_an_object_of_one_region_shows_it_in_all_its_pixels():
    mesh, pose = box(), posed_box(np.random.default_rng(1))
    label = label_of(mesh, pose)
    (found,) = visible_regions(label, CAMERA, [(0, pose)], {0: whole(mesh)})
    assert_allclose(found.mask, label == 1)
    assert found.visible > 0.85


def test_a_face_toward_the_camera_is_wholly_visible():
    mesh, x_toward_camera = box(), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    pose = make_pose(x_toward_camera, np.array([0.0, 0.0, 0.5]))
    found = visible_regions(label_of(mesh, pose), CAMERA, [(0, pose)], {0: halves(mesh)})
    assert found[0].name == "right"
    assert found[0].visible > 0.9  # all but pixels at its edges


def test_the_visible_share_falls_by_the_hidden_pixels():
    mesh, pose = box(), posed_box(np.random.default_rng(2))
    label = label_of(mesh, pose)
    columns = np.flatnonzero((label == 1).any(axis=0))
    hidden = label.copy()
    hidden[:, : int(columns.mean())] = 0
    (seen,) = visible_regions(label, CAMERA, [(0, pose)], {0: whole(mesh)})
    (part,) = visible_regions(hidden, CAMERA, [(0, pose)], {0: whole(mesh)})
    assert 0.2 * seen.visible < part.visible < 0.8 * seen.visible


def test_an_open_surface_is_as_visible_from_behind():
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.05
    sheet = Mesh(square, np.array([[0, 1, 2], [0, 2, 3]]))
    turned = Mesh(square, sheet.faces[:, ::-1].copy())
    pose, shares = make_pose(np.eye(3), [0.0, 0.0, 0.5]), []
    for mesh in (sheet, turned):
        (found,) = visible_regions(label_of(mesh, pose), CAMERA, [(0, pose)], {0: whole(mesh)})
        shares.append(found.visible)
    assert min(shares) > 0.95


def test_symmetries_are_given_in_the_camera_frame():
    mesh, pose = box(), posed_box(np.random.default_rng(3))
    (found,) = visible_regions(label_of(mesh, pose), CAMERA, [(0, pose)], {0: whole(mesh)})
    assert_allclose(found.symmetries[0].normal, pose[:3, 0])
    assert_allclose(found.symmetries[0].point, pose[:3, 3])


def test_objects_without_regions_or_pixels_give_nothing():
    mesh, pose = box(), posed_box(np.random.default_rng(5))
    label = label_of(mesh, pose)
    assert visible_regions(label, CAMERA, [(0, pose)], {}) == []
    assert visible_regions(np.zeros_like(label), CAMERA, [(0, pose)], {0: halves(mesh)}) == []


def triangle_seen(triangles, ray):
    """The first triangle that `ray` (3,) from the origin hits, by trying all; -1 for none."""
    a, b, c = triangles.swapaxes(0, 1)
    system = np.stack([b - a, c - a, np.broadcast_to(-ray, a.shape)], axis=2)
    u, v, depth = np.linalg.solve(system, -a[..., None])[..., 0].T
    met = (np.minimum(u, v) >= 0.0) & (u + v <= 1.0) & (depth > 0.0)
    return np.where(met, depth, np.inf).argmin() if met.any() else -1


def test_masks_equal_rays_tried_triangle_by_triangle_where_parts_hide_each_other():
    mesh = ball_beside_box()
    in_box = np.arange(len(mesh.faces)) >= len(mesh.faces) - 12
    in_crown = ~in_box & (mesh.triangles[..., 2].min(axis=1) > 0.005)
    # The ball's lower half is in no region, but hides the surfaces behind it.
    regioned = RegionedObject(
        mesh,
        (
            ObjectRegion("box", np.flatnonzero(in_box), ()),
            ObjectRegion("crown", np.flatnonzero(in_crown), ()),
        ),
    )
    camera = Intrinsics(60.0, 60.0, 19.5, 14.5, 40, 30)
    toward = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # the ball is in front of the box
    pose = make_pose(toward, np.array([0.001, 0.002, 0.2]))
    label = cast_view(Scene([mesh], [pose]), camera, np.eye(4)).object_index + 1
    expected = np.full(label.shape, -1)
    triangles = transform_points(pose, mesh.triangles)
    for v, u in np.argwhere(label == 1):
        ray = np.array([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0])
        seen = triangle_seen(triangles, ray)
        expected[v, u] = -1 if seen < 0 else regioned.region_of_triangle[seen]
    found = {r.name: r.mask for r in visible_regions(label, camera, [(0, pose)], {0: regioned})}
    assert (expected == -1)[label == 1].any()
    unhidden = cast_view(Scene([mesh.submesh(in_box)], [pose]), camera, np.eye(4))
    assert 0 < (expected == 0).sum() < (unhidden.object_index == 0).sum()
    for index, name in enumerate(("box", "crown")):
        np.testing.assert_array_equal(found[name], expected == index)
