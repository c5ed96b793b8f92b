"""symmetry/NNN.json and the hand-written regions/NNN.json."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.testing import assert_array_equal

from pipelines.dataset.symmetry import regions, symmetry_labels
from pipelines.dataset.symmetry.symmetry_labels import ObjectSymmetries
from pipelines.errors import FormatError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import (
    ObjectRegion,
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
)
from pipelines.storage.provenance import is_finished, make_stamp

STAMP = make_stamp("annotate-symmetry", {"max_planes": 3})
directions = hnp.arrays(float, 3, elements=st.floats(-1, 1)).filter(
    lambda v: np.linalg.norm(v) > 0.1
)
points = hnp.arrays(float, 3, elements=st.floats(-2, 2))


@pytest.fixture
def mesh() -> Mesh:
    shape = trimesh.creation.box(extents=(2, 2, 2))
    return Mesh(np.asarray(shape.vertices), np.asarray(shape.faces))


@settings(max_examples=25, deadline=None)
@given(directions, points, st.none() | st.integers(2, 12))
def test_symmetries_survive_json_with_all_their_digits(
    direction: np.ndarray, point: np.ndarray, order: int | None
) -> None:
    unit = direction / np.linalg.norm(direction)
    made = (
        ReflectionSymmetry(unit, point, 0.01),
        RotationSymmetry(unit, point, order, 0.02),
        SphereSymmetry(point, 0.03),
    )
    text = json.dumps([symmetry_labels.symmetry_to_json(symmetry) for symmetry in made])
    again = symmetry_labels.symmetries_from_json(Path("x.json"), json.loads(text))
    for first, second in zip(made, again, strict=True):
        assert first.kind == second.kind
        assert first.error == second.error
        assert_array_equal(first.point, second.point)
        np.testing.assert_allclose(first.direction, second.direction, rtol=1e-15)
    assert isinstance(again[1], RotationSymmetry)
    assert again[1].order == order


def test_a_label_file_comes_back_and_is_stamped(tmp_path: Path) -> None:
    plane = ReflectionSymmetry(np.array([1.0, 0, 0]), np.zeros(3), 0.004)
    region = ObjectRegion("handle", np.array([3, 4, 7]), (SphereSymmetry(np.ones(3)),))
    path = tmp_path / "005.json"
    symmetry_labels.write(path, ObjectSymmetries("mug", (plane,), (region,)), STAMP)
    again = symmetry_labels.read(path)
    assert again.name == "mug"
    assert again.symmetries[0].error == 0.004
    assert again.regions[0].name == "handle"
    assert again.regions[0].triangles.tolist() == [3, 4, 7]
    assert is_finished(path, STAMP)
    content = json.loads(path.read_text())
    assert content["symmetries"][0] == {
        "kind": "reflection", "normal": [1.0, 0.0, 0.0], "point": [0.0, 0.0, 0.0], "error": 0.004,
        "source": "found",
    }  # fmt: skip


@pytest.mark.parametrize(
    "content",
    [
        [],
        {"object": "x"},
        {"symmetries": [{"kind": "mirror"}]},
        {"symmetries": [{"kind": "reflection", "point": [0, 0, 0]}]},
        {"symmetries": [{"kind": "reflection", "normal": [0, 0, 0], "point": [0, 0, 0]}]},
        {"symmetries": [{"kind": "sphere", "point": [0, 0]}]},
        {"symmetries": [{"kind": "sphere", "point": [0, 0, 0], "error": float("nan")}]},
        {"symmetries": [], "regions": [{"name": "a"}]},
        {"symmetries": [], "regions": [{"triangles": [1.5]}]},
        {"symmetries": [], "regions": [{"triangles": [-1]}]},
    ],
)
def test_a_wrong_label_file_is_reported_in_one_sentence(tmp_path: Path, content: object) -> None:
    path = tmp_path / "005.json"
    path.write_text(json.dumps(content))
    with pytest.raises(FormatError, match=r"005\.json"):
        symmetry_labels.read(path)


def test_a_manual_region_is_a_list_or_a_box_of_triangles(tmp_path: Path, mesh: Mesh) -> None:
    axis = {"kind": "rotation", "axis": [0, 0, 1], "point": [0, 0, 0]}
    content = {
        "regions": [
            {"name": "lid", "box": [[-2, -2, 0.9], [2, 2, 2]], "symmetries": [axis]},
            {"name": "rest", "triangles": [0, 1]},
        ]
    }
    path = tmp_path / "005.json"
    path.write_text(json.dumps(content))
    lid, rest = regions.read(path, mesh)
    assert_array_equal(mesh.vertices[mesh.faces[lid.triangles]][..., 2], 1.0)
    assert len(lid.triangles) == 2
    assert lid.symmetries is not None
    assert lid.symmetries[0].kind == "rotation"
    assert rest.symmetries is None


AXIS = {"kind": "rotation", "axis": [0, 0, 1], "point": [0, 0, 0]}


@pytest.mark.parametrize(
    ("entries", "sentence"),
    [
        ([{"triangles": [0], "box": [[0, 0, 0], [1, 1, 1]]}], "either `triangles` or `box`"),
        ([{"name": "neither"}], "either `triangles` or `box`"),
        ([7], "either `triangles` or `box`"),
        ([{"name": "lid", "triangles": [3, 99]}], "'lid' names triangle 99, .* has 12"),
        ([{"name": "lid", "triangles": [3, 3]}], "'lid' names a triangle twice"),
        ([{"name": "lid", "triangles": []}], "'lid' has no triangles"),
        ([{"triangles": [1.5]}], "indices from 0"),
        ([{"name": "lid", "box": [[5, 5, 5], [6, 6, 6]]}], "'lid' has no triangles; its box"),
        ([{"box": [1, 2]}], "two corners"),
        ([{"box": [[1, 1, 1], [-1, -1, -1]]}], "lower corner first"),
        ([{"box": [[None, 0, 0], [1, 1, 1]]}], "corners|two corners"),
        (
            [{"name": "a", "triangles": [0, 1]}, {"name": "b", "triangles": [2, 1]}],
            "'a' and 'b' share 1 triangle, 1 the first; a triangle is in one",
        ),
        ([], "is empty"),
        ([{"triangles": [0], "symmetries": [{**AXIS, "axis": [0, 0, 10]}]}], "unit vector"),
        ([{"triangles": [0], "symmetries": [{**AXIS, "axis": [0, 0, 0]}]}], "unit vector"),
        ([{"triangles": [0], "symmetries": [{"kind": "rotation"}]}], "lacks 'axis'"),
        ([{"name": "lid", "triangles": [0], "symmetries": AXIS}], "'lid' are no list"),
    ],
)
def test_a_bad_file_of_regions_is_reported_in_one_sentence(
    tmp_path: Path, mesh: Mesh, entries: list[object], sentence: str
) -> None:
    path = tmp_path / "005.json"
    path.write_text(json.dumps({"regions": entries}))
    with pytest.raises(FormatError, match=sentence) as caught:
        regions.read(path, mesh)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_doubt_that_is_no_number_is_unknown(tmp_path):
    for text in ("NaN", "Infinity", '"large"', "null"):
        (tmp_path / "a.json").write_text(f'{{"symmetries": [], "doubt": {text}}}')
        assert symmetry_labels.read(tmp_path / "a.json").doubt is None
