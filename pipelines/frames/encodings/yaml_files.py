"""Small YAML files that hold cameras or their poses: of ROS, OpenCV, other tools, or typed by hand.

PyYAML's plainest loader makes only texts, lists and dictionaries. Texts that look like numbers are
converted here, since YAML 1.1 takes 0600 for 384, 1e3 for a text and 1:30 for 90.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import yaml
from yaml.composer import ComposerError

from pipelines.contents import encoding_of
from pipelines.errors import FormatError
from pipelines.storage.files import existing

Value = float | str | list["Value"] | dict[str, "Value"] | None

CAMERA_EXPECTED = "a YAML file of a camera is expected"
MAX_YAML_BYTES = 2**20  # bytes; cameras have some thousand
MAX_LEVELS = 20  # levels; cameras have three
NULLS = ("", "~", "null", "Null", "NULL")
UNPRINTABLE = yaml.reader.Reader.NON_PRINTABLE
LENIENT = (
    (re.compile(r"^%.*$", re.M), ""),  # OpenCV's %YAML:1.0, and directives without a --- below
    (re.compile(r"^(\s*[\w.]+):(?=[^\s:])", re.M), r"\1: "),  # fx:600, which OpenCV reads
    (re.compile(r"\](\s+)\["), r"],\1["),  # rows as numpy prints them
)


class _PlainLoader(yaml.BaseLoader):
    """Loader of texts, lists and dictionaries of bounded depth, without tags and aliases.

    If a mapping has a key twice, the first value counts.
    """

    depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Return the next node, unless it is an alias, by which a small file grows without end."""
        if self.check_event(yaml.AliasEvent):
            raise ComposerError(problem="an alias", problem_mark=self.get_mark())
        if self.depth == MAX_LEVELS:
            problem = f"more than {MAX_LEVELS} levels, one in another"
            raise ComposerError(problem=problem, problem_mark=self.get_mark())
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        if isinstance(node, yaml.MappingNode):
            node.value.reverse()  # PyYAML keeps the last of equal keys
        return node


def read_yaml(path: Path) -> Value:
    """Return the top-level values of a YAML file; of several documents, each key's first value.

    A file without a key, such as that of a bare matrix, gives its first list or text.

    A document that adds no key is the last that is read, so that a long recording of one camera
    costs no more than its first message; damage after the first mapping or list is ignored.

    Raises:
        FormatError: the file is damaged, too large, too deep, or has aliases.
    """
    content: dict[str, Value] = {}
    bare: Value = None
    for document in _documents(path):
        if isinstance(document, dict):
            known = len(content)
            content = document | content
            if len(content) == known:
                break
        elif bare is None:
            bare = document
    return content or bare


def _documents(path: Path) -> Iterator[Value]:
    """Yield the documents of `path`, up to the first damaged one."""
    loader = _PlainLoader(_text(path))
    is_first = True
    try:
        while loader.check_data():  # type: ignore[no-untyped-call]
            yield (found := _value(loader.get_data()))
            is_first = is_first and not isinstance(found, dict | list)
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # the last two: of \\U escapes
        if is_first:
            raise FormatError(path, _sentence(error), CAMERA_EXPECTED) from error


def _text(path: Path) -> str:
    """Return whole documents of the file, at most `MAX_YAML_BYTES`, in PyYAML's form."""
    with existing(path).open("rb") as stream:
        data = stream.read(MAX_YAML_BYTES + 1)
    if len(data) > MAX_YAML_BYTES:
        data, _mark, _rest = data.rpartition(b"\n---")
        if not data:
            found = f"a document of more than {MAX_YAML_BYTES} bytes"
            raise FormatError(path, found, CAMERA_EXPECTED)
    text = UNPRINTABLE.sub("\ufffd", data.decode(encoding_of(data), errors="replace")).expandtabs()
    for pattern, replacement in LENIENT:
        text = pattern.sub(replacement, text)
    return text


def _value(stored: object) -> Value:
    """Return `stored` with numbers for texts that are numbers, a list for several numbers."""
    match stored:
        case dict():
            return {key: _value(each) for key, each in stored.items()}
        case list():
            return [_value(each) for each in stored]
    text = str(stored).strip()
    if text in NULLS:
        return None
    try:
        numbers = [float(part) for part in re.split(r"[\s,]+", text)]
    except ValueError:
        return text
    return numbers[0] if len(numbers) == 1 else list(numbers)


def _sentence(error: Exception) -> str:
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark:
        return f"line {error.problem_mark.line + 1} cannot be read ({error.problem})"
    return f"this is no YAML ({' '.join(str(error).split())})"
