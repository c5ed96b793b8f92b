"""Figures of GraspNet's protocol from the verdicts on frames."""

import numpy as np

from pipelines.evaluation.graspnet.dump_verdicts import DUMP_STATUSES
from pipelines.evaluation.graspnet.graspnet_figures import DumpTotals
from pipelines.metrics.graspnet.graspnet_ap import AP_FRICTIONS, RANKS


def test_a_frame_without_a_file_counts_as_failed_except_in_the_mean_over_present_frames():
    absent = next(i for i, name in enumerate(DUMP_STATUSES) if name != "ok")
    accuracy = np.zeros((4, RANKS, len(AP_FRICTIONS)))
    accuracy[0, :, 2:] = 0.6  # a frame whose grasps hold from a friction of 0.6 on
    totals = DumpTotals()
    totals.add(
        {
            "frame_id": np.arange(4),
            "status": np.array([DUMP_STATUSES.index("ok")] * 3 + [absent]),
            "accuracy": accuracy,
            "reason": np.full((4, RANKS), -1),
            **{name: np.zeros(4, int) for name in ("rows", "left_out", "straightened")},
        }
    )
    found = totals.figures()
    mean = 0.6 * 4 / 6  # over the frictions
    np.testing.assert_allclose([found["ap"], found["ap_present"]], [mean / 4, mean / 3])
    np.testing.assert_allclose([found["ap_0.4"], found["ap_0.8"]], [0.0, 0.6 / 4])
    assert (found["frames"], found["frames_absent"]) == (4, 1)
