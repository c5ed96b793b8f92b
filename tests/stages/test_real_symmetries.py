"""Regions and symmetries of real frames, against masks and symmetries noted by a person."""

import numpy as np
import pytest

from tests.stages.real_frames import CHANGES, FRAMES, instances_of

WITHIN = np.radians(10.0)

pytestmark = pytest.mark.skipif(not FRAMES.is_dir(), reason=f"{FRAMES} is not there")


@pytest.fixture(scope="module", params=CHANGES, ids=lambda change: change.__name__)
def instances(request, tmp_path_factory):
    return instances_of(request.param, tmp_path_factory.mktemp("frames"))


def share(right):
    missed = [name for name, good in right.items() if not good]
    return len(right) - len(missed), f"{len(right) - len(missed)} of {len(right)}, missed {missed}"


def test_four_of_five_instances_are_found_as_regions(instances):
    count, verdicts = share({each.name: each.overlap >= 0.5 for each in instances})
    assert len(instances) == 38
    assert count >= 0.8 * len(instances), verdicts


def test_four_of_five_upright_axes_stand_on_the_table(instances):
    upright = [each for each in instances if each.kind == "rotation" and each.upright]
    cosine = {each.name: abs(float(each.direction[3] @ each.up)) for each in upright}
    count, verdicts = share({name: value > np.cos(WITHIN) for name, value in cosine.items()})
    assert len(upright) == 10
    assert count >= 0.8 * len(upright), verdicts


def test_four_of_five_boxes_have_an_upright_plane(instances):
    boxes = [each for each in instances if each.shape.startswith("box")]
    lean = {each.name: np.abs(each.direction[:3] @ each.up) for each in boxes}
    count, verdicts = share({name: (value < np.sin(WITHIN)).any() for name, value in lean.items()})
    assert len(boxes) == 13
    assert count >= 0.8 * len(boxes), verdicts
