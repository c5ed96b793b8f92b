"""The frames of a long run, which both commands read, and its summary."""

import json
from itertools import islice

from benchmarks.long_run import ResourceSample, frames, resource_summary
from pipelines.frames.frames import find_frames
from pipelines.serving.posted_frames import posted_frame


def test_frames_can_be_read_and_posted_and_all_differ(tmp_path):
    made = list(islice(frames(), 5))
    assert len({frame.depth for frame in made}) == 5
    made[0].write(tmp_path, "a")
    (found,) = find_frames(tmp_path)
    frame, posted = found.read(), posted_frame(made[0].posted(), 10**6)
    assert frame.depth.shape == (300, 400) == posted.depth.shape
    assert json.loads(made[0].posted())["intrinsics"]["width"] == 400


def test_the_summary_compares_the_last_quarter_with_the_first_after_the_warm_up():
    samples = [ResourceSample(m, "serve", 7 * m, m % 5, 900.0 + m, 7, 6) for m in range(1, 25)]
    row = resource_summary(samples).splitlines()[2]
    assert row == "| `serve` | 168 | 24 | 907 | 922 | 924 | 7 | 7 | 6 | 6 | 4 |"
