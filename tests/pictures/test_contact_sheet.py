"""Contact sheets and the pictures on them."""

from urllib.parse import unquote, urlsplit

import numpy as np
import pytest
import trimesh

from pipelines.dataset.symmetry.symmetry_labels import ObjectSymmetries
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.symmetry import (
    ObjectRegion,
    ReflectionSymmetry,
    RotationSymmetry,
    SphereSymmetry,
)
from pipelines.pictures import contact_sheet
from pipelines.pictures.contact_sheet import SHEET_COLUMNS, SHEET_ROWS, Tile, write_sheets
from pipelines.pictures.symmetry_pictures import PLANES, REGIONS, marks_of, object_views
from pipelines.storage.images import read_image
from tests.evaluation.page_reader import Reader

X, Y, Z = np.eye(3)
ORIGIN = np.zeros(3)
PLANE, AXIS = ReflectionSymmetry(X, ORIGIN, 0.01), RotationSymmetry(Z, ORIGIN, None, 0.02)


@pytest.fixture
def box():
    shape = trimesh.creation.box((0.08, 0.05, 0.03))
    return Mesh(np.asarray(shape.vertices), np.asarray(shape.faces))


def tile(name, doubt, symmetries=()):
    labels = ObjectSymmetries(name, tuple(symmetries), doubt=doubt)
    return Tile(name, np.full((200, 400, 3), 255, np.uint8), labels, f"objects/{name}.png")


def colored(picture, color, tolerance=40):
    """Return the number of pixels with nearly this hue: the same direction from grey."""
    wanted = np.array(color, float) - np.mean(color)
    there = picture - picture.mean(axis=2, keepdims=True)
    length = np.linalg.norm(there, axis=2)
    cosine = there @ wanted / np.maximum(length * np.linalg.norm(wanted), 1e-9)
    return int(((cosine > 0.97) & (length > tolerance)).sum())


def test_planes_axes_and_spheres_are_drawn_in_their_colours(box):
    plain = object_views(box, ObjectSymmetries("a", ()))
    assert plain.shape == (200, 400, 3)
    planes = object_views(box, ObjectSymmetries("a", (PLANE, ReflectionSymmetry(Y, ORIGIN))))
    for color in PLANES[:2]:
        assert colored(planes, color) > 150 > colored(plain, color)
    for symmetry in (AXIS, SphereSymmetry(ORIGIN)):
        assert colored(object_views(box, ObjectSymmetries("a", (symmetry,))), (215, 20, 20)) > 150


def test_a_plane_is_drawn_where_the_object_does_not_hide_it(box):
    """Pixels in front of the sheet do not change; pixels behind it are tinted."""
    plain = object_views(box, ObjectSymmetries("a", ()))
    drawn = object_views(box, ObjectSymmetries("a", (PLANE,)))
    assert drawn.shape == plain.shape
    assert 0.02 < np.mean((drawn != object_views(box, ObjectSymmetries("a", ()))).any(2)) < 0.9


def test_regions_have_different_colours(box):
    halves = [ObjectRegion(n, np.arange(6) + s, ()) for n, s in (("a", 0), ("b", 6))]
    picture = object_views(box, ObjectSymmetries("a", (), tuple(halves)))
    for color in REGIONS[:2]:
        assert colored(picture, color, tolerance=15) > 300


def test_a_part_that_covers_an_object_without_symmetry_shows_the_parts_symmetry(box):
    part = ObjectRegion("part0", np.arange(12), (PLANE,))
    only_rejected = ObjectSymmetries("a", (), (), rejected=(AXIS,))
    marks = marks_of(box, ObjectSymmetries("a", (), (part,), rejected=(AXIS,)))
    assert [mark.symmetry for mark in marks] == [PLANE]
    assert [mark.dashed for mark in marks_of(box, only_rejected)] == [True]
    whole = ObjectSymmetries("a", (PLANE,), (ObjectRegion("whole", np.arange(12), (PLANE,)),))
    assert len(marks_of(box, whole)) == 1


def test_objects_of_unknown_doubt_come_first_and_then_the_most_doubtful(tmp_path):
    tiles = [tile("calm", 0.1), tile("unknown", None), tile("edge", 0.9)]
    (page,) = write_sheets(tmp_path, tiles)
    index = (tmp_path / "index.html").read_text()
    assert index.index("unknown") < index.index("edge") < index.index("calm")
    assert read_image(page).shape[1] == SHEET_COLUMNS * 410 + 10


def test_pages_hold_24_objects_and_older_pages_are_removed(tmp_path):
    tiles = [tile(f"t{number:02d}", 0.5) for number in range(SHEET_COLUMNS * SHEET_ROWS + 1)]
    assert [path.name for path in write_sheets(tmp_path, tiles)] == ["sheet_01.png", "sheet_02.png"]
    for name in ("sheet_100.png", "sheet_of_mine.png"):
        (tmp_path / name).touch()
    write_sheets(tmp_path, tiles[:3])
    assert {path.name for path in tmp_path.glob("sheet_*")} == {"sheet_01.png", "sheet_of_mine.png"}


def test_names_cannot_break_the_page(tmp_path):
    write_sheets(tmp_path, [tile('<script>&"', 0.5, [PLANE])])
    reader = Reader((tmp_path / "index.html").read_text())
    assert "script" not in [tag for tag, _ in reader.found]
    assert '1. <script>&"' in reader.text
    (picture,) = [attrs for tag, attrs in reader.found if tag == "img"]
    assert (unquote(picture["src"]), picture["alt"]) == ('objects/<script>&".png', '<script>&"')


@pytest.mark.parametrize("name", ["nut#1 50%.2", "what?", "箱 %23"])
def test_the_index_shows_pictures_of_names_with_characters_of_addresses(tmp_path, name):
    write_sheets(tmp_path, [tile(name, 0.5)])
    reader = Reader((tmp_path / "index.html").read_text(encoding="utf-8"))
    (picture,) = [attrs for tag, attrs in reader.found if tag == "img"]
    assert unquote(urlsplit(picture["src"]).path) == f"objects/{name}.png"


def test_facts_of_an_object_are_written_in_words():
    order = RotationSymmetry(Z, ORIGIN, 6, 0.001)
    labels = ObjectSymmetries("nut", (PLANE, PLANE, order), rejected=(AXIS,))
    assert contact_sheet.facts(labels) == "2 mirrors, axis x6, error 0.0100"
    assert contact_sheet.remark(labels) == "nearest rejected: round axis, error 0.0200"
    by_hand = ObjectSymmetries("nut", (PLANE,), sources=("hand",), found=())
    assert contact_sheet.remark(by_hand) == "by hand"
    parts = (ObjectRegion("body", np.arange(3), (AXIS,)),)
    assert contact_sheet.remark(ObjectSymmetries("mug", (), parts)) == "body: round axis"
