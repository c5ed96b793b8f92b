"""Corrections of symmetries by hand."""

import json

import numpy as np
import pytest

from pipelines.dataset.symmetry import symmetry_edits
from pipelines.dataset.symmetry.symmetry_labels import BY_HAND, FOUND, FROM_BOP
from pipelines.errors import FormatError, SymgraspError
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SphereSymmetry

X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)
FOUND_HERE = (
    ReflectionSymmetry(X, ORIGIN),
    ReflectionSymmetry(Y, ORIGIN),
    RotationSymmetry(Z, ORIGIN, 2),
)
SOURCES = (FOUND, FOUND, FROM_BOP)
CANDIDATE = ReflectionSymmetry(Z, 0.01 * Z)
PLANE = {"kind": "reflection", "normal": [0, 0, 1], "point": [0, 0, 0]}


def write(path, entries, name="003"):
    path.write_text(json.dumps({name: entries}))
    return path


def applied(tmp_path, *entries):
    edits = symmetry_edits.read(write(tmp_path / "edits.json", list(entries)))["003"]
    return symmetry_edits.apply(edits, FOUND_HERE, SOURCES, (CANDIDATE,))


def test_a_file_without_corrections_changes_nothing(tmp_path):
    symmetries, sources = applied(tmp_path)
    assert tuple(symmetries) == FOUND_HERE
    assert tuple(sources) == SOURCES


def test_a_dropped_symmetry_is_gone_and_indices_do_not_move(tmp_path):
    drop = [{"drop": {"kind": "reflection", "index": index}} for index in (0, 1)]
    symmetries, sources = applied(tmp_path, *drop)
    assert symmetries == [FOUND_HERE[2]]
    assert sources == [FROM_BOP]


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ('{"003": [{"drop": {"index": 0}, "drop": {"index": 1}}]}', "drop"),
        ('{"003": [], "004": [], "003": [{"accept": {"index": 0}}]}', "003"),
    ],
)
def test_a_name_that_is_repeated_is_refused_since_its_first_value_would_be_lost(
    tmp_path, text, name
):
    path = tmp_path / "edits.json"
    path.write_text(text)
    with pytest.raises(FormatError, match=f"edits.json: this names '{name}' twice in one object"):
        symmetry_edits.read(path)


def test_an_added_plane_joins_the_planes_and_is_marked_as_made_by_hand(tmp_path):
    symmetries, sources = applied(tmp_path, {"add": PLANE})
    assert [s.kind for s in symmetries] == ["reflection"] * 3 + ["rotation"]
    assert symmetries[2].normal.tolist() == [0, 0, 1]
    assert sources == [FOUND, FOUND, BY_HAND, FROM_BOP]


def test_a_fix_changes_the_named_fields_and_keeps_the_rest(tmp_path):
    fix = {"kind": "rotation", "index": 0, "order": 4}
    symmetries, sources = applied(tmp_path, {"fix": fix})
    assert symmetries[2].order == 4
    assert applied(tmp_path, {"fix": fix | {"order": 4.0}})[0][2].order == 4
    assert symmetries[2].axis.tolist() == Z.tolist()
    assert sources == [FOUND, FOUND, BY_HAND]


def test_a_rejected_candidate_is_accepted(tmp_path):
    symmetries, sources = applied(tmp_path, {"accept": {"index": 0}})
    assert symmetries[2] is CANDIDATE
    assert sources[2] == BY_HAND


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        ({"drop": {"kind": "reflection", "index": 2}}, "has reflection 0, reflection 1, rotation"),
        ({"drop": {"kind": "mirror", "index": 0}}, "one of reflection, rotation, sphere"),
        ({"fix": {"kind": "sphere", "index": 0, "point": [0, 0, 0]}}, "003 has no sphere 0"),
        ({"fix": {"kind": "rotation", "index": 0, "normal": [0, 0, 1]}}, "one of axis"),
        ({"add": {"kind": "rotation", "axis": [1, 0, 0], "point": [0, 0, 0]}}, "room for 1"),
        ({"add": {"kind": "reflection", "point": [0, 0, 0]}}, "lacks 'normal'"),
        ({"fix": {"kind": "rotation", "index": 0, "order": 2.7}}, "order is 2.7; it must be null"),
        ({"fix": {"kind": "rotation", "index": 0, "order": "4"}}, "order is '4'; it must be null"),
        ({"fix": {"kind": "rotation", "index": 0, "order": True}}, "order is True"),
        ({"fix": {"kind": "rotation", "index": 0, "order": float("inf")}}, "order is inf"),
        ({"accept": {"index": 1}}, "has no rejected candidate 1; it has 1"),
    ],
)
def test_a_missing_symmetry_is_reported_in_one_sentence_that_lists_the_known_ones(
    tmp_path, entry, sentence
):
    with pytest.raises(SymgraspError, match=sentence):
        applied(tmp_path, entry)


@pytest.mark.parametrize(
    ("entries", "error"),
    [
        ({"drop": {}}, FormatError),
        ([{"drop": {}, "add": {}}], FormatError),
        ([{"drop": 3}], FormatError),
        ([{"delete": {"kind": "reflection", "index": 0}}], FormatError),
    ],
)
def test_a_file_of_another_form_is_refused(tmp_path, entries, error):
    with pytest.raises(error, match="003"):
        symmetry_edits.read(write(tmp_path / "edits.json", entries))


def test_the_digest_covers_only_the_corrections_of_one_object(tmp_path):
    entries = [{"add": PLANE}]
    first = symmetry_edits.read(write(tmp_path / "a.json", entries))["003"]
    (tmp_path / "b.json").write_text(json.dumps({"001": [], "003": entries}))
    second = symmetry_edits.read(tmp_path / "b.json")
    assert first.digest == second["003"].digest != second["001"].digest


def test_a_sphere_may_be_added(tmp_path):
    symmetries, _ = applied(tmp_path, {"add": {"kind": "sphere", "point": [0, 0, 0]}})
    assert isinstance(symmetries[-1], SphereSymmetry)
