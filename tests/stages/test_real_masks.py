"""Real objects in masks that a person drew are grasped, with the table's depth and without."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pipelines import infer
from pipelines.configs import InferConfig
from pipelines.runtime.batch import BatchOptions
from tests.grasp_files.whole_file import read_whole
from tests.stages.real_frames import FRAMES, labelled_frames

PLANAR = InferConfig(method="planar")

pytestmark = pytest.mark.skipif(not FRAMES.is_dir(), reason=f"{FRAMES} is not there")


@pytest.mark.parametrize("alone", [False, True], ids=["with the table", "alone"])
def test_nearly_all_masked_objects_are_grasped(tmp_path, alone):
    (tmp_path / "frames").mkdir()
    count = 0
    for frame in labelled_frames():
        seen = frame.label > 0
        shown = replace(frame, depth=np.where(seen, frame.depth, 0)) if alone else frame
        shown.write(tmp_path / "frames")
        cv2.imwrite(str(tmp_path / f"{frame.stem}_label.png"), frame.label)
        count += len(np.unique(frame.label[seen]))
    paths = infer.InferPaths(tmp_path / "frames", tmp_path / "grasps.h5", masks=tmp_path)
    infer.run(paths, PLANAR, BatchOptions(progress=False))
    grasped = int(read_whole(paths.output).grasps.is_best.sum())
    assert count == 38
    assert grasped >= 36, f"{grasped} of {count}"
