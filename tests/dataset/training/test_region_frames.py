"""Frames of a dataset with their visible regions."""

import pytest

from pipelines.dataset.training import region_frames
from tests.stages.toy_root import frame_names, write_root


@pytest.mark.parametrize("most", [3, 2])
def test_the_regions_of_a_frame_are_the_largest_and_the_largest_comes_first(
    most, tmp_path, monkeypatch
):
    monkeypatch.setattr(region_frames, "MAX_REGIONS", most)
    root = write_root(tmp_path)
    files = root.frame(frame_names()[0])
    found = region_frames.read_region_frame(root, files, min_pixels=100).regions
    label = root.read_label(files)  # each object is one region
    sizes = sorted(((label == i + 1).sum() for i in range(3)), reverse=True)
    assert [each.mask.sum() for each in found] == sizes[:most]
