"""Trials of grasps by score, and the interval of the difference between score and success rate."""

import numpy as np
import trimesh
from numpy.testing import assert_allclose

from pipelines.dataset import convex_pieces
from pipelines.dataset.meshes import read_mesh
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.grasp_files.gripper_files import load_gripper
from tests.stages.toy_root import frame_names, true_result, write_root
from tools.score_reliability import TriedGrasp, excess, reliability_rows, tried_grasps


def test_a_grasp_under_a_board_of_the_scene_collides_as_in_simulate(tmp_path):
    root, name = write_root(tmp_path), frame_names()[0]
    for object_id in root.object_ids():
        model = root.model_path(object_id)
        convex_pieces.write(model.with_name("convex.npz"), [read_mesh(model)])
    result = true_result(root, name, (1,))

    def held() -> list[bool]:
        return [each.held for each in tried_grasps(result, root, load_gripper("rg2"), 0.5)]

    assert held() == [True]
    board = trimesh.creation.box(
        (0.4, 0.4, 0.02), trimesh.transformations.translation_matrix((0.12, 0.03, 0.15))
    )
    mesh = Mesh(np.asarray(board.vertices), np.asarray(board.faces))
    convex_pieces.write(root.scene(100, "realsense").surroundings_path, [mesh])
    assert held() == [False]


def test_the_interval_is_over_scenes_and_not_over_similar_grasps():
    rng = np.random.default_rng(0)
    alike = [TriedGrasp(scene, 0.8, held) for scene, held in enumerate(rng.random(10) < 0.5)]
    more, low, high = excess(alike)
    assert_allclose(more, 0.8 - np.mean([each.held for each in alike]))
    assert low < more < high
    assert_allclose(excess(alike * 20), (more, low, high))


def test_a_row_has_the_success_of_its_bin():
    tried = [TriedGrasp(0, 0.95, True), TriedGrasp(0, 0.97, False), TriedGrasp(1, 0.1, False)]
    rows = reliability_rows(tried)[2:]
    assert [row.split(" | ")[:4] for row in rows] == [
        ["| 0.1-0.2", "1", "0.10", "0.00"],
        ["| 0.9-1.0", "2", "0.96", "0.50"],
    ]
