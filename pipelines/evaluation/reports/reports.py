"""`report.json` of `evaluate`, figures by row and split, and `success.json` of `simulate`."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pipelines.contents import mapping_in, reading, typed
from pipelines.errors import FormatError, SymgraspError
from pipelines.evaluation.rows import OURS
from pipelines.storage.files import finite_json, read_json, write_json
from pipelines.storage.provenance import PAGE_HEAD, Stamp, sidecar_of

FORMAT_VERSION = 1
WITH = "with "  # before a row's name, in the keys of the digests of a stamp
OUR_PAGE = re.compile(r"<title>(SymGrasp\b|.*GraspNet&#39;s AP)")  # of a report, of a dump
WHICH_OBJECTS = ("min_visible_pixels", "min_region_share")  # settings of evaluate and of simulate


@dataclass(frozen=True)
class GivenTable:
    """A table of text that a report shows after its own tables: `evaluate --table`."""

    title: str
    header: list[str]
    rows: list[list[str]]
    note: str = ""


def write_report(
    path: Path,
    rows: Mapping[str, Mapping[str, Any]],
    stamp: Stamp,
    *,
    seconds_per_frame: float | None = None,
    **more: Any,  # noqa: ANN401 - JSON is any of many types
) -> None:
    """Write a report with `more` JSON entries.

    `rows`: row, of `evaluation.rows`, to split (seen, similar, novel, all) to figures; an undefined
    figure, nan, is stored as null. `seconds_per_frame`: median run time of `infer`.
    """
    content = {
        "rows": rows,
        "seconds_per_frame": seconds_per_frame,
        **more,
        "format_version": FORMAT_VERSION,
        "provenance": stamp.as_json(),
    }
    write_json(path, finite_json(content))


def read_report(path: Path) -> dict[str, Any]:
    """Read a report as a JSON object.

    Raises:
        FormatError: the file has no `rows`.
    """
    content = read_json(path)
    if not isinstance(content, dict) or not isinstance(content.get("rows"), dict):
        raise FormatError(path, "lacks `rows`", "a report.json of `symgrasp evaluate` is expected")
    return content


def read_table(path: Path) -> dict[str, Any]:
    """Read a table of text as a JSON object with the fields of `GivenTable`.

    Raises:
        FormatError: the file is no table, or a row is longer or shorter than the header.
    """
    expected = "a title, a header and rows of text as long as the header are expected"
    with reading(path, "a table", expected):
        table: GivenTable = typed(GivenTable, read_json(path))
    for row in table.rows:
        if len(row) != len(table.header):
            raise FormatError(
                path, f"has {len(row)} cells in a row, {len(table.header)} in the header", expected
            )
    return asdict(table)


def refuse_other_page(report: Path) -> None:
    """Raise SymgraspError if the page to write next to `report` exists and is no report's.

    A page of `compare`, which has a stamp next to it, is none.
    """
    page = report.with_suffix(".html")
    if not page.is_file():
        return
    with page.open(encoding="utf-8", errors="replace") as stream:
        is_ours = OUR_PAGE.search(stream.read(PAGE_HEAD)) and not sidecar_of(page).exists()
    if not is_ours:
        raise SymgraspError(
            f"{page}, which is written too, exists and is no page of a report; choose another --out"
        )


def is_success(path: Path) -> bool:
    """Return whether a JSON file is a `success.json`, not a `report.json`."""
    content = read_json(path)
    return isinstance(content, dict) and "success" in content and "rows" not in content


def read_success(path: Path) -> dict[str, Any]:
    """Read the success rates that `simulate` wrote.

    Raises:
        FormatError: the file is no success.json, or has another version.
    """
    content: dict[str, Any] = read_json(path)
    for name, kind in (("success", dict), ("frictions", list)):
        if not isinstance(content, dict) or not isinstance(content.get(name), kind):
            raise FormatError(path, f"lacks `{name}`", "a success.json of `simulate` is expected")
    if content.get("format_version") != FORMAT_VERSION:
        found = f"has format_version {content.get('format_version')}"
        raise FormatError(path, found, f"this symgrasp reads {FORMAT_VERSION}")
    return content


def read_successes(paths: Sequence[Path], stamp: Stamp) -> dict[str, dict[str, Any]]:
    """Read the success rates of rows: row to the content of its file.

    `stamp`: of the report. Of its inputs, `grasps` is our row and `with NAME` is another row; the
    digests of the gripper and of the dataset's labels, meshes and scenes must equal those of the
    simulation, and so must the settings that decide which objects and grasps are tried.

    Raises:
        FormatError: as `read_success`; or a file has other grasps, another gripper, another
            dataset or other settings; or two files have one row.
    """
    inputs = stamp.inputs
    rows = {inputs[key]: key.removeprefix(WITH) for key in inputs if key.startswith(WITH)}
    rows[inputs["grasps"]] = OURS
    found: dict[str, dict[str, Any]] = {}
    for path in paths:
        content = read_success(path)
        origin = mapping_in(content, "provenance")
        known = mapping_in(origin, "inputs")
        row = rows.get(str(known.get("grasps")))
        if row is None:
            raise FormatError(path, "was simulated from other grasps", "run simulate on these")
        both = (inputs.keys() & known.keys()) - {"grasps"}
        other = sorted(name for name in both if known[name] != inputs[name])
        if other:
            raise FormatError(
                path,
                f"was simulated with other inputs ({', '.join(other)})",
                "run simulate with this gripper on this dataset",
            )
        if changed := _other_settings(origin, stamp, row):
            raise FormatError(
                path,
                f"was simulated with other settings ({', '.join(changed)})",
                "run simulate and evaluate with the same ones",
            )
        if row in found:
            raise FormatError(path, f"is a second file of row {row}", "give one file per row")
        found[row] = content
    return found


def incomplete_notes(simulated: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """Return a note for each row whose rates, as `read_successes` gives them, lack scenes."""
    notes = {}
    for row, content in simulated.items():
        if failed := mapping_in(content, "failed"):
            name, why = next(iter(failed.items()))
            notes[f"success of {row}"] = (
                f"the rates lack what failed in `simulate`, {len(failed)} of its scenes and "
                f"models, for example {name}: {why}"
            )
    return notes


def _other_settings(origin: Mapping[str, Any], stamp: Stamp, row: str) -> list[str]:
    """Return each setting of a simulation's stamp that tries other objects or grasps of `row`.

    The seed draws the random grasps of the baselines, which are read with our own row.
    """
    config = mapping_in(origin, "config")
    pairs = {name: (config.get(name), stamp.config.get(name)) for name in WHICH_OBJECTS}
    if row == OURS and config.get("baselines") and stamp.config.get("baselines"):
        pairs["seed"] = origin.get("seed"), stamp.seed
    return [
        f"{name} {theirs} instead of {ours}"
        for name, (theirs, ours) in pairs.items()
        if None not in (theirs, ours) and theirs != ours
    ]
