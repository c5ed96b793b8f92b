"""The numbers of the small YAML files that cameras are written to, without a YAML library.

ROS alone writes one matrix in three ways: `K: [1, 2, ...]`, `k:` with a line `- 1` a number, and
`camera_matrix:` with `rows`, `cols` and `data` below it, which is OpenCV's way too.
"""

import re
from pathlib import Path

from pipelines.storage.files import existing

Value = float | str | list[float]

COMMENT = re.compile(r"(?:^|(?<=\s))#.*$", re.M)
# A key at the left margin, a tag such as !!opencv-matrix, and what belongs to it: a list in
# brackets, or the rest of its line and all lines below that are indented or begin with a dash.
ENTRY = re.compile(
    r"^(\w+):[ \t]*(?:!\S*[ \t]*)?(\[[^:]*\][ \t]*$|.*(?:\n(?:[ \t]+.*|-[ \t].*|[ \t]*)$)*)", re.M
)
BELOW = re.compile(r"^[ \t]+(\w+):[ \t]*([^:]*)(?=^[ \t]+\w+:|\Z)", re.M)
NULLS = ("", "~", "null", "Null", "NULL")


def read_flat_yaml(path: Path) -> dict[str, Value]:
    """Return the top-level values of a YAML file, of several documents the first that has each.

    Lists, however deep, are the numbers in them, one after the other; of what has keys of its own
    only `data` counts. A value that is no number is its text, so that whoever asks for a number
    can say what stands there.
    """
    text = existing(path).read_text(encoding="utf-8", errors="replace")
    content: dict[str, Value] = {}
    for key, stored in ENTRY.findall(COMMENT.sub("", text)):
        below = dict(BELOW.findall(stored))
        value = _value(below.get("data", "") if below else stored)
        if value is not None:
            content.setdefault(key, value)
    return content


def _value(text: str) -> Value | None:
    text = text.strip()
    if text in NULLS:
        return None
    is_list = text.startswith(("[", "- "))
    parts = [part for part in re.split(r"[\s,\[\]]+", text) if part not in ("", "-")]
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        return text
    return numbers if is_list or len(numbers) != 1 else numbers[0]
