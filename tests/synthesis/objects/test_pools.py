"""Procedural objects are closed, of household size, and as symmetric as they claim."""

from functools import cache

import numpy as np
import pytest
from manifold3d import Manifold, Mesh64
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.errors import UnknownNameError
from pipelines.geometry.meshes.mesh import sample_surface
from pipelines.geometry.symmetry import (
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
    SymmetrySlots,
)
from pipelines.geometry.transforms import unit
from pipelines.synthesis.objects.families.catalogue import FAMILIES, make_shape
from pipelines.synthesis.objects.pools import FAMILIES_OF_POOL, make_object

ASYMMETRIC = ("lumpy", "sculpture", "stone", "heap", "decoy_carton", "slipper", "carved")
FLAT = 1e-7  # metres; triangles of a face within this distance count as one plane for the solid
every_family = pytest.mark.parametrize("family", FAMILIES)
made_once = cache(make_object)


def make_pool(pool, count, seed):
    return [make_object(pool, index, seed) for index in range(count)]


def instance(family):
    pool = next(pool for pool in FAMILIES_OF_POOL if family in FAMILIES_OF_POOL[pool])
    return made_once(pool, FAMILIES_OF_POOL[pool].index(family), 11)


@cache
def whole_pool(pool):
    return [made_once(pool, index, 11) for index in range(len(FAMILIES_OF_POOL[pool]))]


@cache
def samples(family, count=150):
    return sample_surface(instance(family).mesh, count, np.random.default_rng(0))[0]


@cache
def solid(family):
    mesh = instance(family).mesh
    # Copies, as the library takes only writable arrays.
    vertices = np.array(mesh.vertices, order="C")
    return Manifold(Mesh64(vertices, np.array(mesh.faces, np.uint64, order="C"))).simplify(FLAT)


def gap(family, image_of):
    """Return how far the object and its image lie apart on average over the surface, metres."""
    origin = image_of(np.zeros(3))
    columns = np.stack([image_of(axis) - origin for axis in np.eye(3)], axis=1)
    image = solid(family).transform(np.column_stack([columns, origin]))
    return (solid(family) - image).volume() / solid(family).surface_area()


def image_under(symmetry):
    if isinstance(symmetry, ReflectionSymmetry):
        return symmetry.counterpart
    if isinstance(symmetry, SphereSymmetry):
        symmetry = RotationSymmetry(np.array([0.6, 0.0, 0.8]), symmetry.point)
    return lambda points: symmetry.turn(points, 2.0 * np.pi / (symmetry.order or 8.7))


def depth_outside(piece, points):
    """Return how far (n,) points are beyond the farthest face plane of a convex piece."""
    offset = np.einsum("fi,fi->f", piece.triangles[:, 0], piece.face_normals)
    return (points @ piece.face_normals.T - offset).max(axis=1)


@every_family
def test_mesh_is_closed_and_turned_outward(family):
    mesh = instance(family).mesh
    assert mesh.is_watertight
    assert mesh.volume > 1e-6


@every_family
def test_mesh_is_fine_enough_to_sample_and_coarse_enough_to_render(family):
    assert 1000 <= len(instance(family).mesh.faces) <= 8500


@every_family
def test_object_has_household_size_about_the_origin(family):
    low, high = instance(family).mesh.bounds
    assert 0.03 <= (high - low).max() <= 0.25
    assert_allclose(low + high, 0.0, atol=1e-9)


@every_family
def test_a_gripper_of_ten_centimetres_can_hold_the_object(family):
    low, high = instance(family).mesh.bounds
    hollow = family in ("bowl", "plate", "ring")  # held at the rim
    assert hollow or (high - low).min() < 0.09


@every_family
def test_declared_symmetries_map_the_object_onto_itself(family):
    for symmetry in instance(family).symmetries:
        assert gap(family, image_under(symmetry)) < 2e-5 + 0.03 * symmetry.error


def test_only_the_asymmetric_families_declare_no_symmetry():
    assert {family for family in FAMILIES if not instance(family).symmetries} == set(ASYMMETRIC)


@pytest.mark.parametrize("family", ASYMMETRIC)
def test_asymmetric_objects_have_no_mirror_plane(family):
    normals = np.concatenate([np.eye(3), np.random.default_rng(2).normal(size=(6, 3))])
    center = samples(family).mean(axis=0)
    for normal in unit(normals):
        assert gap(family, ReflectionSymmetry(normal, center).counterpart) > 3e-4


@pytest.mark.parametrize(
    ("family", "normal"),
    [
        ("mug", [1, 0, 0]),
        ("bottle", [0, 0, 1]),
        ("wedge", [1, 0, 0]),
        ("hammer", [1, 0, 0]),
        ("decoy_can", [1, 0, 0]),
        ("decoy_bottle", [1, 0, 0]),
        ("twisted_bar", [1, 0, 0]),
        ("twisted_bar", [0, 0, 1]),
        ("faceted", [0, 0, 1]),
    ],
)
def test_undeclared_planes_do_not_hold(family, normal):
    assert gap(family, ReflectionSymmetry(np.array(normal), np.zeros(3)).counterpart) > 3e-4


@every_family
def test_pieces_are_convex(family):
    for piece in instance(family).pieces:
        assert piece.is_watertight
        assert piece.volume > 0
        assert depth_outside(piece, piece.vertices).max() < 1e-6


@every_family
def test_pieces_cover_the_surface(family):
    points = samples(family)
    outside = np.min([depth_outside(piece, points) for piece in instance(family).pieces], axis=0)
    assert outside.max() < 2e-3


@every_family
def test_pieces_do_not_fill_much_more_than_the_object(family):
    made = instance(family)
    assert sum(piece.volume for piece in made.pieces) < 1.5 * made.mesh.volume


def test_vessels_stay_open():
    for family in ("bowl", "cup", "mug"):
        made = instance(family)
        inside = np.array([[0.0, 0.0, made.mesh.bounds[1, 2] - 0.01]])
        assert min(depth_outside(piece, inside)[0] for piece in made.pieces) > 0.005


def test_symmetries_fit_the_slots_of_the_paper():
    slots = {f: SymmetrySlots.from_symmetries(instance(f).symmetries).probability for f in FAMILIES}
    assert_array_equal(slots["ball"], [0, 0, 0, 0, 1])
    assert_array_equal(slots["can"], [1, 0, 0, 1, 0])
    assert_array_equal(slots["bottle"], [0, 0, 0, 1, 0])
    assert_array_equal(slots["mug"], [1, 0, 0, 0, 0])
    assert_array_equal(slots["carton"], [1, 1, 1, 0, 0])
    assert_array_equal(slots["lumpy"], [0, 0, 0, 0, 0])


def test_same_seed_makes_the_same_objects():
    first, second = (make_pool("novel", 5, seed=3) for _ in range(2))
    for one, other in zip(first, second, strict=True):
        assert one.name == other.name
        assert_array_equal(one.mesh.vertices, other.mesh.vertices)
        assert_array_equal(one.mesh.faces, other.mesh.faces)


def test_a_longer_pool_starts_with_the_shorter_one():
    short, long = make_pool("seen", 2, seed=3), make_pool("seen", 4, seed=3)
    assert [made.name for made in long[:2]] == [made.name for made in short]
    assert_array_equal(long[1].mesh.vertices, short[1].mesh.vertices)


def test_pools_share_no_object_and_novel_ones_no_family():
    seen, similar = make_pool("seen", 6, seed=3), make_pool("similar", 6, seed=3)
    assert [made.family for made in seen] == [made.family for made in similar]
    for one, other in zip(seen, similar, strict=True):
        assert abs(one.mesh.volume / other.mesh.volume - 1.0) > 1e-6
    assert not set(FAMILIES_OF_POOL["seen"]) & set(FAMILIES_OF_POOL["novel"])


def test_every_family_is_present_and_every_name_occurs_once():
    pool = whole_pool("novel")
    assert {made.family for made in pool} == set(FAMILIES_OF_POOL["novel"])
    assert len({made.name for made in pool}) == len(pool)


def test_unknown_pools_and_families_are_refused():
    with pytest.raises(UnknownNameError, match="known are novel, sealed, seen, similar, wide"):
        make_pool("old", 1, seed=0)
    with pytest.raises(UnknownNameError, match="teacup"):
        make_shape("teacup", np.random.default_rng(0))
