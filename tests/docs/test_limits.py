"""Agreement of the bounds in docs/reference/limits.md with those in the code."""

import re
from pathlib import Path

import pytest

from pipelines import contents
from pipelines.configs import toml_files
from pipelines.dataset import meshes
from pipelines.frames.encodings import exr_files, mat_files, plain_pickle, yaml_files
from pipelines.geometry import symmetry
from pipelines.grasp_files import gripper_urdf
from pipelines.storage import array_files, h5_files, images

PAGE = Path(__file__).resolve().parents[2] / "docs/reference/limits.md"
UNITS = {"KiB": 2**10, "MiB": 2**20, "million": 10**6}


@pytest.mark.parametrize(
    ("data", "bounds"),
    [
        ("pixels of an image", [contents.MAX_PIXELS]),
        ("bytes of an image", [images.MAX_IMAGE_BYTES]),
        ("channels of an EXR", [exr_files.MAX_CHANNELS]),
        ("arrays of an `.npz`", [array_files.MAX_UNPACK_BYTES]),
        ("HDF5: datasets", [h5_files.MAX_UNPACKED_BYTES, h5_files.MAX_UNPACK_RATIO]),
        ("HDF5: groups", [h5_files.MAX_LINKS]),
        (
            "JSON",
            [contents.MAX_JSON_BYTES, contents.MAX_JSON_VALUES, contents.MAX_JSON_DEPTH],
        ),
        ("TOML", [toml_files.MAX_BYTES, toml_files.MAX_LEVELS]),
        ("YAML", [yaml_files.MAX_YAML_BYTES, yaml_files.MAX_LEVELS]),
        ("MATLAB", [mat_files.MAX_BYTES]),
        ("pickles", [plain_pickle.MAX_BYTES, plain_pickle.MAX_VALUES, plain_pickle.MAX_DEPTH]),
        ("a URDF", [gripper_urdf.MAX_LINKS]),
        ("a mesh", [meshes.MAX_MESH_BYTES, meshes.MAX_TRIANGLES]),
        ("order of a rotation", [symmetry.MAX_ORDER]),
    ],
)
def test_the_page_states_the_bounds_of_the_code(data, bounds):
    (cell,) = re.findall(rf"^\| {re.escape(data)}[^|]*\| (.*) \|$", PAGE.read_text("utf-8"), re.M)
    numbers = re.findall(r"(\d[\d,]*)(?: (\w+))?", re.sub(r"\(.*?\)", "", cell))
    assert [int(n.replace(",", "")) * UNITS.get(unit, 1) for n, unit in numbers] == bounds
