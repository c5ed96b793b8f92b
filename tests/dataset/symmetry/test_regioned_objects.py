"""An object with its regions, which belong only to the mesh that they were cut from."""

import json

import pytest

from pipelines.dataset.meshes import read_mesh, write_mesh
from pipelines.dataset.symmetry import symmetry_labels
from pipelines.dataset.symmetry.regioned_objects import read_regioned_object
from pipelines.errors import FormatError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.storage.provenance import digest, make_stamp
from tests.stages.toy_root import write_root


@pytest.fixture
def root(tmp_path):
    """A dataset whose labels of object 0 name the mesh that they are made from."""
    made = write_root(tmp_path)
    path, inputs = made.symmetry_path(0), {"mesh": digest(made.model_path(0))}
    labels = symmetry_labels.read(path)
    symmetry_labels.write(path, labels, make_stamp("annotate-symmetry", {}, inputs=inputs))
    return made


def turn_order(root):
    mesh = read_mesh(root.model_path(0))
    write_mesh(root.model_path(0), Mesh(mesh.vertices, mesh.faces[::-1].copy()))


def test_regions_of_another_mesh_are_refused(root):
    assert len(read_regioned_object(root.root, 0).regions) == 1
    turn_order(root)
    with pytest.raises(FormatError, match=r"000.json: it was made with .* annotate it again"):
        read_regioned_object(root.root, 0)


@pytest.mark.parametrize("stamp", [None, "me", {}, {"inputs": "me"}, {"inputs": {}}])
def test_labels_by_hand_need_not_name_their_mesh(root, stamp):
    path = root.symmetry_path(0)
    content = json.loads(path.read_text()) | {"provenance": stamp}
    path.write_text(json.dumps(content))
    turn_order(root)
    assert len(read_regioned_object(root.root, 0).regions) == 1
