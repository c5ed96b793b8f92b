"""The manifest of the default weights."""

import numpy as np
import pytest

from pipelines.errors import FormatError
from pipelines.storage.files import write_json
from pipelines.storage.provenance import make_stamp, read_stamp
from pipelines.storage.weights_manifest import (
    GoldenGrasps,
    Manifest,
    read_manifest,
    write_manifest,
)

STAMP = make_stamp("golden-frame", {})


def test_a_manifest_is_read_as_it_was_written(tmp_path):
    rotation = np.stack([np.eye(3), np.diag([1.0, -1, -1])])
    grasps = GoldenGrasps(rotation, np.arange(6.0).reshape(2, 3), np.array([0.02, 0.05]))
    write_manifest(tmp_path / "m.json", Manifest({"a": "sha256:0"}, "f", grasps), STAMP)
    found = read_manifest(tmp_path / "m.json")
    assert (found.files, found.frame) == ({"a": "sha256:0"}, "f")
    for name in ("rotation", "translation", "width"):
        np.testing.assert_array_equal(getattr(found.grasps, name), getattr(grasps, name))
    assert read_stamp(tmp_path / "m.json") == STAMP.as_json()


@pytest.mark.parametrize(
    "content",
    [
        [],
        {"files": {}, "frame": "f"},
        {"files": [], "frame": "f", "grasps": []},
        {"files": {}, "frame": "f", "grasps": [{"rotation": 1, "translation": 2, "width": 3}]},
        {
            "files": {},
            "frame": "f",
            "grasps": [{"rotation": np.eye(3).tolist(), "translation": [0] * 6, "width": 3}],
        },
    ],
)
def test_a_wrong_manifest_is_refused_with_the_command_that_makes_one(tmp_path, content):
    write_json(tmp_path / "m.json", content)
    with pytest.raises(FormatError, match=r"tools/golden_frame\.py"):
        read_manifest(tmp_path / "m.json")
