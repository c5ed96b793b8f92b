"""Corrections of symmetries by hand: `--edit FILE` of `annotate-symmetry`.

    {"003": [{"drop": {"kind": "reflection", "index": 1}},
             {"fix": {"kind": "rotation", "index": 0, "point": [0, 0, 0.01]}},
             {"add": {"kind": "reflection", "normal": [1, 0, 0], "point": [0, 0, 0]}},
             {"accept": {"index": 0}}]}

Indices count the detected symmetries, each kind from 0, as numbered in the pictures; they do not
change when another entry drops a symmetry. `accept` takes one of the object's `rejected`
candidates. An empty list means that a person checked the object and agrees.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipelines.dataset.symmetry.symmetry_labels import (
    BY_HAND,
    symmetries_from_json,
    symmetry_to_json,
)
from pipelines.errors import FormatError, SymgraspError
from pipelines.geometry.symmetry import SYMMETRY_KINDS, Symmetry
from pipelines.storage.files import read_json
from pipelines.storage.provenance import digest_text

ACTIONS = ("accept", "add", "drop", "fix")
MAX_OF_KIND = {"reflection": 3, "rotation": 1, "sphere": 1}


@dataclass(frozen=True)
class ObjectEdits:
    """The corrections of one object, as in its entry of the file."""

    path: Path
    name: str
    entries: tuple[Mapping[str, Any], ...]

    @property
    def digest(self) -> str:
        """Digest of the corrections of this object."""
        return digest_text(json.dumps(self.entries, sort_keys=True))


def read(path: Path) -> dict[str, ObjectEdits]:
    """Read the corrections of each object.

    Raises:
        FormatError: the file is malformed.
    """
    content = read_json(path, by_hand=True)
    if not isinstance(content, dict):
        raise FormatError(path, "the corrections are no object", '{"NAME": [...], ...}')
    return {name: _object_edits(path, name, entries) for name, entries in content.items()}


def _object_edits(path: Path, name: str, entries: Any) -> ObjectEdits:  # noqa: ANN401 - JSON
    if not isinstance(entries, list):
        raise FormatError(
            path, f"the corrections of {name} are no list", "a list of actions is expected"
        )
    for entry in entries:
        if not isinstance(entry, dict) or len(entry) != 1:
            raise FormatError(path, f"a correction of {name} is not one action", _one_of(ACTIONS))
        ((action, content),) = entry.items()
        if action not in ACTIONS:
            raise FormatError(path, f"no action {action!r} of {name} is known", _one_of(ACTIONS))
        if not isinstance(content, dict):
            raise FormatError(
                path, f"{action} of {name} is no object", "kind, index, ... in braces"
            )
    return ObjectEdits(path, name, tuple(entries))


def apply(
    edits: ObjectEdits,
    found: Sequence[Symmetry],
    sources: Sequence[str],
    rejected: Sequence[Symmetry],
) -> tuple[list[Symmetry], list[str]]:
    """Return the corrected symmetries of an object, planes first, and their sources.

    `sources`: sources of `found`.

    Raises:
        SymgraspError: the object lacks an index or kind; the message lists the existing
            symmetries.
    """
    kept = dict(enumerate(zip(found, sources, strict=True)))
    added: list[tuple[Symmetry, str]] = []
    for entry in edits.entries:
        ((action, content),) = entry.items()
        match action:
            case "drop":
                kept.pop(_place(edits, content, found), None)
            case "fix":
                place = _place(edits, content, found)
                kept[place] = (_fixed(edits, content, found[place]), BY_HAND)
            case "add":
                added.append((symmetries_from_json(edits.path, [content])[0], BY_HAND))
            case _:
                added.append((rejected[_candidate(edits, content, rejected)], BY_HAND))
    pairs = [kept[place] for place in sorted(kept)] + added
    pairs.sort(key=lambda pair: SYMMETRY_KINDS.index(pair[0].kind))
    _refuse_too_many(edits, [symmetry for symmetry, _ in pairs])
    return [symmetry for symmetry, _ in pairs], [source for _, source in pairs]


def _fixed(edits: ObjectEdits, content: Mapping[str, Any], old: Symmetry) -> Symmetry:
    changes = {key: value for key, value in content.items() if key != "index"}
    known = symmetry_to_json(old)
    for key in changes:
        if key not in known:
            found = f"{key!r} is no parameter of a {old.kind} of {edits.name}"
            raise FormatError(edits.path, found, _one_of(known))
    return symmetries_from_json(edits.path, [known | changes])[0]


def _place(edits: ObjectEdits, content: Mapping[str, Any], found: Sequence[Symmetry]) -> int:
    """Return the position in `found` of the symmetry that `kind` and `index` name."""
    kind, index = content.get("kind"), content.get("index")
    if kind not in SYMMETRY_KINDS:
        sentence = f"{kind!r} is no kind of symmetry of {edits.name}"
        raise FormatError(edits.path, sentence, _one_of(SYMMETRY_KINDS))
    places = [place for place, symmetry in enumerate(found) if symmetry.kind == kind]
    if not isinstance(index, int) or not 0 <= index < len(places):
        raise SymgraspError(
            f"{edits.path}: {edits.name} has no {kind} {index}; it has {_listed(found)}"
        )
    return places[index]


def _candidate(edits: ObjectEdits, content: Mapping[str, Any], rejected: Sequence[Symmetry]) -> int:
    index = content.get("index")
    if not isinstance(index, int) or not 0 <= index < len(rejected):
        raise SymgraspError(
            f"{edits.path}: {edits.name} has no rejected candidate {index}; it has {len(rejected)}"
        )
    return index


def _one_of(names: Iterable[str]) -> str:
    return f"one of {', '.join(sorted(names))}"


def _listed(found: Sequence[Symmetry]) -> str:
    kinds = [symmetry.kind for symmetry in found]
    listed = [f"{kind} {i}" for kind in SYMMETRY_KINDS for i in range(kinds.count(kind))]
    return ", ".join(listed) or "no symmetry"


def _refuse_too_many(edits: ObjectEdits, symmetries: Sequence[Symmetry]) -> None:
    for kind, most in MAX_OF_KIND.items():
        count = sum(symmetry.kind == kind for symmetry in symmetries)
        if count > most:
            raise SymgraspError(
                f"{edits.path}: {edits.name} would have {count} of {kind}; "
                f"it has room for {most}, so drop one"
            )
