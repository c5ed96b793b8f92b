"""Objects that scenes of earlier runs show are not replaced by others."""

import pytest

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import SymgraspError
from pipelines.frames.graspnet_scene import write_object_ids
from pipelines.runtime.batch import WorkItem
from pipelines.storage.provenance import make_stamp, write_sidecar
from pipelines.synthesis.objects.shown_objects import refuse_to_replace_shown

OLD, NEW = (make_stamp("synthesize object", {}, seed=seed) for seed in (0, 1))


@pytest.fixture
def root(tmp_path):
    """Scene 0 shows the objects 0 and 1, scene 100 shows object 1."""
    made = GraspNetRoot(tmp_path)
    for object_id in range(2):
        folder = made.model_path(object_id).parent
        folder.mkdir(parents=True)
        write_sidecar(folder, OLD)
    for scene_id, shown in ((0, [0, 1]), (100, [1])):
        write_object_ids(made.scene_folder(scene_id) / "object_id_list.txt", shown)
    return made


def items(root, stamps):
    return {i: WorkItem("", root.model_path(i).parent, stamp) for i, stamp in stamps.items()}


def test_a_scene_that_stays_keeps_its_objects(root):
    with pytest.raises(SymgraspError, match="scene_0100 shows object 001, which would be replaced"):
        refuse_to_replace_shown(root, items(root, {0: NEW, 1: NEW}), [0])


@pytest.mark.parametrize(
    ("stamps", "scenes"),
    [({0: OLD, 1: OLD}, []), ({0: NEW, 1: OLD}, [0]), ({0: NEW, 1: NEW}, [0, 100]), ({2: NEW}, [])],
)
def test_the_same_objects_new_ones_and_those_of_scenes_made_again_may_be_written(
    root, stamps, scenes
):
    refuse_to_replace_shown(root, items(root, stamps), scenes)


def test_a_damaged_stamp_or_list_of_objects_does_not_hide_the_fault(root):
    (root.model_path(1).parent / "provenance.json").write_text("{")
    (root.scene_folder(0) / "object_id_list.txt").write_text("?")
    with pytest.raises(SymgraspError, match="scene_0100 shows object 001"):
        refuse_to_replace_shown(root, items(root, {1: OLD}), [])
