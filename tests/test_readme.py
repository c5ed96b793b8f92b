"""What the README shows works as shown."""

import re
from pathlib import Path

import pytest

from pipelines import infer
from pipelines.batch import BatchOptions
from pipelines.configs import InferConfig

README = Path(__file__).resolve().parents[1] / "README.md"
FRAMES = README.parent / "pipelines" / "weights" / "frames"


@pytest.fixture
def grasps(tmp_path, monkeypatch):
    paths = infer.InferPaths(FRAMES, tmp_path / "grasps.h5")
    config = InferConfig(regions="geometric", method="planar")
    report = infer.run(paths, config, BatchOptions(progress=False))
    assert report.failed == {}
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("grasps")
def test_the_readmes_python_lines_read_the_best_grasps():
    (code,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(code, "README.md", "exec"), names)  # the project's own text
    rotation, translation = names["best"]
    assert len(rotation) == len(translation) > 4


def test_files_and_folders_that_the_readme_links_to_exist():
    text = README.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)#]+)\)", text):
        assert (README.parent / link).exists(), link
