"""Labels through the post-processing of planar methods."""

import numpy as np
import pytest

from pipelines.grasp_files.grasps_stream import read_results
from pipelines.grasping.peers.rectangles import rectangle_hits, rectangle_rows
from tests.stages.toy_grasp_labels import write_rects
from tests.stages.toy_root import best_grasp, frame_names, write_root
from tools.peer_oracle import REPRESENTATIONS, write_oracle


@pytest.mark.parametrize("name", REPRESENTATIONS)
def test_rectangles_come_back_right(name):
    represented, least = REPRESENTATIONS[name]
    sizes = np.full(2, 60.0), np.full(2, 30.0), np.array([1.0, least])
    rows = rectangle_rows(np.array([[150.0, 200.0], [400.0, 300.0]]), np.array([0.3, -1.0]), *sizes)
    found = represented(rows, (480, 640))
    assert len(found) == 2
    assert rectangle_hits(found, rows).all()


@pytest.mark.parametrize("name", REPRESENTATIONS)
def test_the_labelled_grasps_of_a_dataset_are_written(name, tmp_path):
    root = write_root(tmp_path / "root")
    write_rects(root)
    out = tmp_path / "oracle.h5"
    assert write_oracle(name, root, out, 1000) == len(frame_names())
    for number, result in enumerate(read_results(out, range(len(frame_names())))):
        assert set(result.grasps.source) == {name}
        middles = [best_grasp(i, number % 2).translation[0] for i in (0, 1, 2)]
        distances = np.linalg.norm(result.grasps.translation[:, None] - middles, axis=2)
        assert (distances.min(axis=0) < 0.04).all()
