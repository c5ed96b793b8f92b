"""Pages of the documentation: line lengths, links, and code blocks that match the code."""

import re
import shlex
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from markdown.extensions.toc import slugify
from typer.main import get_command

from pipelines import infer
from pipelines.configs import InferConfig
from pipelines.runtime.batch import BatchOptions
from symgrasp_cli.app import app

ROOT = Path(__file__).resolve().parents[2]
FRAMES = ROOT / "pipelines" / "weights" / "frames"
PAGES = sorted(
    [
        *(ROOT / "docs").rglob("*.md"),
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        ROOT / "pipelines" / "weights" / "README.md",
        ROOT / "training" / "README.md",
    ]
)
COMMANDS = get_command(app).commands
ROOT_OPTIONS = {name for each in get_command(app).params for name in each.opts}
OTHERS_OPTIONS = {"--nproc-per-node", "--no-python", "--force-reinstall"}  # torchrun, pip
RUN_ELSEWHERE = {"README.md", "api.md", "formats.md"}  # by tests that check the result
MAX_LINE = 120


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def prose_of(page: Path) -> str:
    """Return the page without its code blocks."""
    return re.sub(r"^```.*?^```$", "", text_of(page), flags=re.MULTILINE | re.DOTALL)


def blocks_of(page: Path, language: str) -> list[str]:
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", text_of(page), re.MULTILINE | re.DOTALL)
    return [code for kind, code in blocks if kind == language]


def shell_lines(page: Path) -> Iterator[list[str]]:
    """Yield the words of each command of the page's shell blocks."""
    for block in [*blocks_of(page, ""), *blocks_of(page, "bash")]:
        for line in block.replace("\\\n", " ").splitlines():
            if re.match(r"\s*(symgrasp|make|python) ", line):
                yield shlex.split(line, comments=True)


def options_of(command: str) -> set[str]:
    each = COMMANDS[command]
    return {name for p in each.params for name in [*p.opts, *p.secondary_opts]} | {"--help"}


def anchors_of(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", prose_of(page), re.MULTILINE)
    return {slugify(re.sub(r"[`*]", "", heading), "-") for heading in headings}


def test_prose_lines_have_at_most_120_characters():
    for page in PAGES:
        lines = prose_of(page).splitlines()
        long = [line for line in lines if len(line) > MAX_LINE and not line.startswith("|")]
        assert not long, page


def test_links_lead_to_files_and_headings_that_exist():
    for page in PAGES:
        for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)", prose_of(page)):
            if target.startswith("http"):
                continue
            path = (page.parent / target).resolve() if target else page
            assert path.exists(), f"{page}: {target}"
            made = "made from code" in (text_of(path) if path.suffix == ".md" else "")
            known = not anchor or made or anchor in anchors_of(path)
            assert known, f"{page}: {target}#{anchor}"


def test_make_targets_and_scripts_in_shell_blocks_exist():
    targets = re.findall(r"^([a-z-]+):", text_of(ROOT / "Makefile"), re.MULTILINE)
    for page, words in [(each, words) for each in PAGES for words in shell_lines(each)]:
        if words[0] == "make":
            assert words[1] in targets, page
        elif words[:2] == ["python", "-m"]:
            assert find_spec(words[2]) is not None, (page, words)
        elif words[0] == "python":
            assert words[1] == "-c" or (ROOT / words[1]).is_file(), (page, words)


def test_options_in_the_text_exist():
    known = ROOT_OPTIONS.union(*map(options_of, COMMANDS), OTHERS_OPTIONS)
    for page in PAGES:
        spans = re.findall(r"`([^`\n]+)`", prose_of(page))
        used = {name for span in spans for name in re.findall(r"(?<![\w-])--[a-z][\w-]+", span)}
        assert used <= known, (page, used - known)


def test_source_files_in_the_text_exist():
    kinds = "pipelines|symgrasp|symgrasp_cli|tests|tools|examples"
    for page in PAGES:
        spans = " ".join(re.findall(r"`([^`\n]+)`", prose_of(page)))
        paths = re.findall(rf"(?<!\S)((?:{kinds})/[\w/.]*\w)(?!\S)", spans)
        lost = [path for path in paths if not (ROOT / path).exists() and "NAME" not in path]
        assert not lost, page


def test_python_blocks_compile():
    for page in PAGES:
        for code in blocks_of(page, "python"):
            compile(code, page.name, "exec")


@pytest.fixture(scope="module")
def folder_with_grasps(tmp_path_factory):
    folder = tmp_path_factory.mktemp("docs")
    paths = infer.InferPaths(FRAMES, folder / "grasps.h5")
    config = InferConfig(regions="geometric", method="planar")
    assert infer.run(paths, config, BatchOptions(progress=False)).failed == {}
    return folder


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if blocks_of(page, "python") and page.name not in RUN_ELSEWHERE],
    ids=lambda path: path.relative_to(ROOT).as_posix(),
)
def test_python_blocks_run(page, folder_with_grasps, monkeypatch):
    monkeypatch.chdir(folder_with_grasps)
    for code in blocks_of(page, "python"):
        exec(compile(code, page.name, "exec"), {})  # the project's own text


def test_every_command_has_a_place_in_the_guides():
    guides = [ROOT / "docs" / "index.md", *(ROOT / "docs" / "how-to").glob("*.md")]
    shown = {words[1] for page in guides for words in shell_lines(page) if words[0] == "symgrasp"}
    assert shown >= set(COMMANDS)


def test_every_page_is_in_the_navigation_or_a_record():
    listed = text_of(ROOT / "mkdocs.yml")
    for page in (ROOT / "docs").rglob("*.md"):
        uri = page.relative_to(ROOT / "docs").as_posix()
        assert uri in listed or re.match(r"decisions/\d", uri), uri
