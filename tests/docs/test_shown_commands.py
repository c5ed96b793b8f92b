"""Every `symgrasp` command that a page or an example shows is one that the command line takes."""

import inspect
import re
import shlex
import tomllib
from collections.abc import Iterator

import pytest
from typer.main import get_command

from pipelines.configs.settings import settings_of
from pipelines.configs.stages import default_settings
from symgrasp_cli import settings
from symgrasp_cli.app import COMMANDS, app
from tests.docs.test_pages import PAGES, ROOT

SOURCES = [*PAGES, *sorted((ROOT / "examples").glob("*.py"))]
GUIDES = [ROOT / "README.md", ROOT / "docs/index.md", *sorted((ROOT / "docs/how-to").glob("*.md"))]
NAMES = [function.__name__.replace("_", "-") for function in COMMANDS]
BLOCK = re.compile(r"^ *```(\w*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
SPAN = re.compile(r"`([^`]+)`")
SHELL = {"", "bash", "sh", "console"}  # languages of blocks with commands
PLACEHOLDER = re.compile(r"[A-Z][A-Z_]*")
OPEN = re.compile(r"--.*|[A-Z][A-Z_]*|[\w.]+=[A-Z]+")  # after an option: its value is not shown
ELISION = "..."


class _WouldRunError(Exception):
    """The command line is valid: its options, arguments and settings."""


def commands_of_blocks(text: str) -> Iterator[list[str]]:
    """Yield the words after `symgrasp` of the commands in shell blocks, with variables' values."""
    for language, block in BLOCK.findall(text):
        if language in SHELL:
            for line in _with_values(block.replace("\\\n", " ")).splitlines():
                if re.search(r"\bsymgrasp ", line):
                    yield from _simple_commands(line)


def _with_values(script: str) -> str:
    """Return a shell script with the first value of each variable and 1 for each sum."""
    script = re.sub(r"\$\(\(.*?\)\)(?!\))", "1", script)
    values = dict(re.findall(r'\b([A-Z]\w*)="([^"\n]*)"', script))
    values |= dict(re.findall(r"\bfor (\w+) in ([^\s;]+)", script))
    return re.sub(r"\$\{?(\w+)\}?", lambda found: values.get(found[1], found[0]), script)


def _simple_commands(line: str) -> Iterator[list[str]]:
    """Yield the words after `symgrasp` of each command between the operators of a shell line."""
    lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
    lexer.whitespace_split = True
    words: list[str] = []
    for word in [*lexer, ";"]:
        if not set(word) <= set(";|&<>()"):
            words.append(word)
            continue
        if "symgrasp" in words[:-1]:
            yield words[words.index("symgrasp") + 1 :]
        words = []


def commands_of_spans(text: str) -> Iterator[list[str]]:
    """Yield the words of the commands in inline code, shown with or without `symgrasp`."""
    for span in SPAN.findall(BLOCK.sub("", text)):
        words = span.split()
        shown = words[1:] if words[:1] == ["symgrasp"] else words if words[0] in NAMES else []
        if shown and re.fullmatch(r"[a-z-]+", shown[0]):
            yield shown


@pytest.fixture(scope="module")
def command_lines():
    """The command line that needs no files and stops before the work; for parts, and for wholes.

    The first also needs no arguments.
    """

    def stop(*_):
        raise _WouldRunError

    with pytest.MonkeyPatch.context() as patch:
        for function in COMMANDS:
            for parameter in inspect.signature(function).parameters.values():
                for each in getattr(parameter.annotation, "__metadata__", ()):
                    patch.setattr(each, "exists", False, raising=False)
        patch.setattr(settings, "read_toml", lambda _: {})
        patch.setattr(settings, "arguments_of", stop)
        parts = get_command(app)
        for command in parts.commands.values():
            for each in command.params:
                each.required = False
        yield parts, get_command(app)


def check(words: list[str], command_lines, *, is_whole: bool) -> None:
    """Read a command as the command line does; raise what it raises.

    A command that is not whole may lack arguments, and the values of its options.
    """
    is_whole = is_whole and ELISION not in words
    group = command_lines[is_whole]
    if words[0].startswith("-"):
        assert words[0] in {name for each in group.params for name in each.opts}, "not known"
        return
    assert words[0] in NAMES, f"{words[0]} is not known"
    command = group.commands[words[0]]
    if not is_whole:
        words = _without_placeholders(words, command)
    if len(words) == 1 and not is_whole:
        return
    try:
        command.main(words[1:], prog_name=words[0], standalone_mode=False)
    except _WouldRunError:
        return


def _without_placeholders(words: list[str], command) -> list[str]:
    """Return `words` without placeholders and without the options that show no value.

    These options must exist.
    """
    options = {name for each in command.params for name in (*each.opts, *each.secondary_opts)}
    kept, rest = [words[0]], [word for word in words[1:] if word != ELISION]
    while rest:
        word = rest.pop(0)
        if word.startswith("--") and (not rest or OPEN.fullmatch(rest[0])):
            assert word in options, f"{words[0]}: no such option: {word}"
        elif not PLACEHOLDER.fullmatch(word):
            kept.append(word)
    return kept


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_shown_commands_are_valid(source, command_lines):
    text = source.read_text(encoding="utf-8")
    for words in commands_of_blocks(text):
        check(words, command_lines, is_whole=True)
    for words in commands_of_spans(text):
        check(words, command_lines, is_whole=False)


@pytest.mark.parametrize("page", GUIDES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_no_two_commands_of_a_guide_make_one_output_with_other_settings(page):
    """Whoever runs the commands of a page one after another meets no refusal."""
    made: dict[tuple[str, str], list[str]] = {}
    for words in commands_of_blocks(page.read_text(encoding="utf-8")):
        is_written = "--out" in words or words[0] == "infer"
        output = words[words.index("--out") + 1] if "--out" in words else "grasps.h5"
        if is_written and not {"--overwrite", "--watch"} & set(words):
            assert made.setdefault((words[0], output), words) == words


def dotted(tables: dict, prefix: str = "") -> Iterator[str]:
    """Yield the dotted names of the values in the tables of a TOML file."""
    for name, value in tables.items():
        yield from dotted(value, f"{prefix}{name}.") if isinstance(value, dict) else [prefix + name]


def test_the_shown_file_of_settings_has_no_names_of_earlier_versions():
    page = (ROOT / "docs/how-to/settings.md").read_text(encoding="utf-8")
    (shown,) = (block for language, block in BLOCK.findall(page) if language == "toml")
    assert set(dotted(tomllib.loads(shown))) <= {
        each.name for each in settings_of(default_settings("infer"))
    }


def test_blocks_and_spans_are_read_as_a_shell_and_a_reader_would():
    page = r"""Use `infer --method
    NAME`, not `simulate`:

    ```
    N="--network a.safetensors"
    for seed in 3 4; do symgrasp train root$seed --seed $((2 * seed)) \
        $N && symgrasp doctor > log; done  # a comment
    ```
    """
    assert list(commands_of_spans(page)) == [["infer", "--method", "NAME"], ["simulate"]]
    trained = ["train", "root3", "--seed", "1", "--network", "a.safetensors"]
    assert list(commands_of_blocks(page)) == [trained, ["doctor"]]


@pytest.mark.parametrize(
    ("command", "is_whole"),
    [
        ("synthesize root --split all", True),
        ("synthesize ROOT --split all", False),
        ("infer frames --spilt all", True),
        ("infer --spilt NAME", False),
        ("infer --spilt", False),
        ("infer", True),
        ("infer frames --set selection.ranking.by=critics", True),
        ("infer frames more", False),
        ("simulate grasps.h5", True),
        ("infre frames", True),
        ("--quiet", True),
    ],
)
def test_a_command_that_is_not_valid_is_found(command, is_whole, command_lines):
    with pytest.raises(Exception, match=r"(?i)(no such option|known|missing|unexpected|root)"):
        check(command.split(), command_lines, is_whole=is_whole)


@pytest.mark.parametrize(
    "command",
    ["infer --method NAME --weights FILE", "config STAGE", "train ...", "--verbose COMMAND ..."],
)
def test_a_part_of_a_command_may_leave_out_arguments_and_values(command, command_lines):
    check(command.split(), command_lines, is_whole=False)
