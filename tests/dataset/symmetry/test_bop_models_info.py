"""BOP's models_info.json: written, read back, and true by BOP's own rule."""

import json

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.dataset.symmetry import bop_models_info
from pipelines.errors import FormatError, SymgraspError
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SphereSymmetry
from pipelines.geometry.transforms import make_pose, random_rotation, rotation_about

X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)
SOLIDS = {
    "box": (
        trimesh.creation.box((0.12, 0.06, 0.04)),
        [ReflectionSymmetry(normal, ORIGIN) for normal in (X, Y, Z)],
    ),
    "can": (
        trimesh.creation.cylinder(0.03, 0.1, sections=128),
        [ReflectionSymmetry(Z, ORIGIN), RotationSymmetry(Z, ORIGIN)],
    ),
    "cone": (trimesh.creation.cone(0.03, 0.1, sections=128), [RotationSymmetry(Z, ORIGIN)]),
    "hexagon": (
        trimesh.creation.cylinder(0.03, 0.02, sections=6),
        [ReflectionSymmetry(X, ORIGIN), ReflectionSymmetry(Z, ORIGIN),
         RotationSymmetry(Z, ORIGIN, 6)],
    ),
    "ball": (trimesh.creation.icosphere(3, 0.04), [SphereSymmetry(ORIGIN)]),
}  # fmt: skip


def solid(name, T=None):
    shape, symmetries = SOLIDS[name]
    mesh = Mesh(np.asarray(shape.vertices), np.asarray(shape.faces))
    T = np.eye(4) if T is None else T
    return mesh.transformed(T), [symmetry.transformed(T) for symmetry in symmetries]


def bop_transforms(entry, steps=16):
    """All symmetry transforms of an entry, millimetres, as BOP's evaluation combines them."""
    discrete = [np.eye(4)]
    discrete += [np.reshape(values, (4, 4)) for values in entry.get("symmetries_discrete", [])]
    turns = []
    for each in entry.get("symmetries_continuous", []):
        axis, offset = np.array(each["axis"]), np.array(each["offset"])
        for step in range(steps):
            R = rotation_about(axis, 2 * np.pi * step / steps)
            turns.append(make_pose(R, offset - R @ offset))
    return [turn @ T for T in discrete for turn in turns or [np.eye(4)]]


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(sorted(SOLIDS)))
def test_every_transform_maps_the_surface_onto_itself(seed, name):
    rng = np.random.default_rng(seed)
    mesh, symmetries = solid(name, make_pose(random_rotation(rng), rng.uniform(-0.2, 0.2, 3)))
    entry = bop_models_info.entry_of(mesh, symmetries)
    points = 1000.0 * sample_surface(mesh, 40, rng)[0]
    surface = trimesh.Trimesh(1000.0 * mesh.vertices, mesh.faces, process=False)
    for T in bop_transforms(entry, steps=5):
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
        moved = points @ T[:3, :3].T + T[:3, 3]
        gap = trimesh.proximity.closest_point_naive(surface, moved)[1]
        assert gap.max() < 0.2  # mm; an odd turn misses by 5


def test_each_solid_has_its_number_of_transforms():
    entries = {name: bop_models_info.entry_of(*solid(name)) for name in SOLIDS}
    discrete = {name: len(e.get("symmetries_discrete", [])) for name, e in entries.items()}
    continuous = {name: len(e.get("symmetries_continuous", [])) for name, e in entries.items()}
    assert discrete == {"box": 3, "can": 1, "cone": 0, "hexagon": 11, "ball": 0}
    assert continuous == {"box": 0, "can": 1, "cone": 1, "hexagon": 0, "ball": 3}


def test_sizes_are_millimetres():
    entry = bop_models_info.entry_of(*solid("box"))
    assert entry["diameter"] == pytest.approx(140.0)
    assert [entry[f"min_{axis}"] for axis in "xyz"] == pytest.approx([-60, -30, -20])
    assert [entry[f"size_{axis}"] for axis in "xyz"] == pytest.approx([120, 60, 40])


def test_a_mesh_of_furniture_size_is_in_metres_too():
    mesh, _ = solid("can", make_pose(np.eye(3), [0.0, 0.0, 0.01]))
    axis = RotationSymmetry(Z, 0.02 * X)
    entry = bop_models_info.entry_of(Mesh(30.0 * mesh.vertices, mesh.faces), [axis])
    assert [entry[f"size_{axis}"] for axis in "xyz"] == pytest.approx([1800, 1800, 3000])
    assert entry["min_z"] == pytest.approx(-1200)
    assert entry["symmetries_continuous"] == [{"axis": [0, 0, 1], "offset": [20, 0, 0]}]


@pytest.mark.parametrize(
    ("name", "kind", "order"),
    [
        ("can", "rotation", None),
        ("cone", "rotation", None),
        ("hexagon", "rotation", 6),
        ("ball", "sphere", None),
        ("box", "rotation", 2),
    ],
)
@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_a_written_rotation_is_read_back_as_the_same_rotation(tmp_path, name, kind, order, unit):
    T = make_pose(rotation_about(X + Y, 0.4), [0.03, 0.1, -0.2])
    mesh, symmetries = solid(name, T)
    path = tmp_path / "models_info.json"
    bop_models_info.write(path, {"obj_000007": (mesh, symmetries)})
    info = bop_models_info.read(path)["7"]
    scaled = Mesh(unit * mesh.vertices, mesh.faces)
    (found,) = bop_models_info.symmetries_of(info, scaled)
    assert found.kind == kind
    assert getattr(found, "order", None) == order
    if kind == "sphere":
        assert np.allclose(found.point, unit * T[:3, 3])
        return
    wanted = [s.axis for s in symmetries if isinstance(s, RotationSymmetry)]
    wanted = wanted or [s.normal for s in symmetries]
    assert max(abs(found.axis @ axis) for axis in wanted) == pytest.approx(1.0)
    assert np.linalg.norm(np.cross(found.point - unit * T[:3, 3], found.axis)) < 1e-6 * unit


def test_the_identity_of_a_whole_group_is_not_read_as_a_turn(tmp_path):
    mesh, half_turn = solid("box")[0], np.diag([-1.0, -1.0, 1.0, 1.0])
    discrete = [np.eye(4).ravel().tolist(), half_turn.ravel().tolist()]
    path = tmp_path / "models_info.json"
    path.write_text(json.dumps({"1": {"symmetries_discrete": discrete}}))
    (found,) = bop_models_info.symmetries_of(bop_models_info.read(path)["1"], mesh)
    assert found.order == 2
    assert abs(found.axis @ Z) == pytest.approx(1.0)
    path.write_text(json.dumps({"1": {"symmetries_discrete": discrete[:1]}}))
    assert bop_models_info.symmetries_of(bop_models_info.read(path)["1"], mesh) == []


def test_a_file_of_another_mesh_is_refused(tmp_path):
    mesh, symmetries = solid("can")
    bop_models_info.write(tmp_path / "m.json", {"1": (mesh, symmetries)})
    info = bop_models_info.read(tmp_path / "m.json")["1"]
    other, _ = solid("box")
    with pytest.raises(SymgraspError, match="mm"):
        bop_models_info.symmetries_of(info, other)


def test_names_without_numbers_are_numbered_and_kept(tmp_path):
    assert bop_models_info.keys_of(["005", "obj_000007"]) == {"005": "5", "obj_000007": "7"}
    assert bop_models_info.keys_of(["mug", "obj_000001"]) == {"mug": "1", "obj_000001": "2"}
    bop_models_info.write(tmp_path / "m.json", {"mug": solid("can")})
    assert bop_models_info.read(tmp_path / "m.json")["mug"].continuous


@pytest.mark.parametrize(
    "entry",
    [
        {"symmetries_discrete": [[1, 2, 3]]},
        {"symmetries_discrete": [np.diag([-1, 1, 1, 1]).ravel().tolist()]},
        {"symmetries_discrete": [np.diag([2, 1, 1, 1]).ravel().tolist()]},
        {"symmetries_continuous": [{"axis": [0, 0, 1]}]},
        {"symmetries_continuous": [{"axis": [0, 0, 0], "offset": [0, 0, 0]}]},
        {"diameter": "large"},
        {"diameter": 0},
        {"diameter": float("inf")},
    ],
)
def test_a_wrong_entry_is_reported_in_one_sentence(tmp_path, entry):
    path = tmp_path / "models_info.json"
    path.write_text(json.dumps({"3": entry}))
    with pytest.raises(FormatError, match="object 3"):
        bop_models_info.read(path)
