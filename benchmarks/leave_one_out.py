"""Leave-one-out over the rules behind `infer`: `python -m benchmarks.leave_one_out FOLDER ...`.

Reads   FOLDER               a dataset with its symmetry/, or any folder of RGB-D frames
Writes  OUT/RULE/FOLDER.h5   grasps of `infer` without that rule
        OUT/RULE/FOLDER.json the report of `evaluate`, of datasets
        OUT/leave_one_out.md differences to the run with all rules, over all datasets together

Finished outputs are not made again: OUT belongs to one state of the code. Results that no rule
changes, mainly the outputs of the networks, are computed once and cached, so all rules share a
process.
"""

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import fields, is_dataclass
from hashlib import blake2b
from pathlib import Path
from pkgutil import resolve_name
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.rules import EVERY_RULE, FITS, RULES, Rule, rules_named
from pipelines import evaluate, infer
from pipelines.array_types import Array
from pipelines.compare import Figure, compared
from pipelines.configs import CompareConfig, EvaluateConfig, InferConfig
from pipelines.configs.settings import changed
from pipelines.errors import SymgraspError, errors_as_sentences
from pipelines.evaluation.runs.paired_runs import EvaluatedRun
from pipelines.evaluation.runs.run_readers import DEFAULT_ROW, read_run
from pipelines.evaluation.truth import FrameTruth, TruthReader
from pipelines.geometry.pointcloud import Plane
from pipelines.inference import models
from pipelines.inference.runs.run_settings import InferPaths
from pipelines.metrics.grasp_verdicts import TrueScene
from pipelines.metrics.symmetry_matching import TrueRegion
from pipelines.network.predictor import GraspPredictor, RegionPrediction
from pipelines.runtime.batch import BatchOptions
from pipelines.storage.files import write_text

METRICS = {
    "grasp_quality": "quality",
    "antipodal_score": "antipodal",
    "symmetry_ap reflection": "AP planes",
    "symmetry_ap rotation": "AP axes",
    "mask_ap50": "mask AP50",
}
UNCHANGED = "no name"
# Functions with cached results, and the prefix of replaced names that change these results.
REMEMBERED = {
    "pipelines.inference.observation.geometric_regions": "pipelines.tabletop.",
    "pipelines.inference.regions.predicted_regions.ground_symmetries": FITS,
    "pipelines.evaluate.TruthReader": UNCHANGED,
    "pipelines.evaluation.baselines.assign_regions": UNCHANGED,
    "pipelines.evaluation.truth.TruthReader.read": UNCHANGED,
    "pipelines.evaluation.frame_scores.match_masks": UNCHANGED,
    "pipelines.evaluation.frame_scores.grasp_verdict": UNCHANGED,
    "pipelines.evaluation.frame_scores.symmetry_verdicts": UNCHANGED,
}
REMEMBERED_OBJECTS = (TruthReader, FrameTruth, TrueScene, TrueRegion)  # each object exists once
NOTE = """\
Differences to the run with all rules (or with the rule in brackets), 95 % intervals of a paired
bootstrap over scenes; a positive difference means that the rule is harmful.
"""


class Memory:
    """Cache of results of functions by their arguments."""

    def __init__(self) -> None:
        self._results: dict[bytes, Any] = {}

    def remembering(self, function: Callable[..., Any], scope: str = "") -> Callable[..., Any]:
        """Return `function` with a cache of its results; `scope` distinguishes its states."""

        def remembered(*arguments: object) -> Any:  # noqa: ANN401 - the result of `function`
            key = blake2b(f"{function.__qualname__} {scope}".encode(), digest_size=16)
            _add(key, arguments)
            if (found := key.digest()) not in self._results:
                self._results[found] = function(*arguments)
            return self._results[found]

        return remembered


class RememberedDetector:
    """A region detector that computes each frame once."""

    def __init__(self, examine: Callable[..., Any]) -> None:
        self.examine = examine


class RememberedPredictor:
    """A grasp network that computes each region once: results do not depend on others (D. 61)."""

    def __init__(self, predictor: GraspPredictor, memory: Memory) -> None:
        def predict_one(cloud: Array, table: Plane | None) -> RegionPrediction:
            return predictor.predict([cloud], table)[0]

        self._predict_one = memory.remembering(predict_one)

    def predict(self, clouds: Sequence[Array], table: Plane | None) -> list[RegionPrediction]:
        """Return one prediction for each cloud (n, 3) on `table`, camera frame."""
        return [self._predict_one(cloud, table) for cloud in clouds]


def _add(key: Any, value: object) -> None:  # noqa: ANN401 - a hash has no public type
    """Add `value`, of arrays, numbers and dataclasses, to the hash `key`."""
    if isinstance(value, REMEMBERED_OBJECTS):
        key.update(f"{id(value)}".encode())
    elif isinstance(value, np.ndarray):
        key.update(f"{value.dtype} {value.shape}".encode())
        key.update(np.ascontiguousarray(value))
    elif isinstance(value, Mapping | list | tuple):
        key.update(f"{type(value).__name__} {len(value)}".encode())
        for each in value.items() if isinstance(value, Mapping) else value:
            _add(key, each)
    elif is_dataclass(value):
        key.update(type(value).__name__.encode())
        for field in fields(value):
            _add(key, getattr(value, field.name))
    elif not isinstance(value, np.random.Generator):  # each frame's starts in the same state
        key.update(repr(value).encode())


@contextmanager
def left_out(rule: Rule, memory: Memory) -> Iterator[InferConfig]:
    """Switch `rule` off in the code; yield the settings without the rule."""
    plain = {name: resolve_name(name) for name in REMEMBERED}
    detector, predictor = models.detector, models.predictor

    def detector_of(path: Path, device: str) -> RememberedDetector:
        return RememberedDetector(memory.remembering(detector(path, device).examine))

    def predictor_of(path: Path, device: str, mirrored: bool = False) -> RememberedPredictor:
        return RememberedPredictor(predictor(path, device, mirrored), memory)

    replaced = {
        "pipelines.inference.models.detector": detector_of,
        "pipelines.inference.models.predictor": predictor_of,
        **rule.replaced,
    }
    for name, function in plain.items():
        inside = any(each.startswith(REMEMBERED[name]) for each in rule.replaced)
        replaced[name] = memory.remembering(function, rule.key if inside else "")
    with ExitStack() as stack:
        for name, value in replaced.items():
            stack.enter_context(patch(name, value))
        yield changed(InferConfig(), rule.settings)


def is_dataset(folder: Path) -> bool:
    """Return whether `folder` is a dataset with ground truth."""
    return (folder / "symmetry").is_dir()


def measure(rule: Rule, folders: Sequence[Path], out: Path, memory: Memory) -> None:
    """Write the grasps of `folders` without `rule`, and the reports of the datasets among them.

    Raises:
        SymgraspError: a frame fails, or an existing output was made with other settings.
    """
    options = BatchOptions(progress=False)
    with left_out(rule, memory) as config:
        for folder in folders:
            grasps, report = out / rule.key / f"{folder.name}.h5", report_of(rule, folder, out)
            failed = {}
            if not grasps.is_file():
                grasps.parent.mkdir(parents=True, exist_ok=True)
                failed = infer.run(InferPaths(folder, grasps), config, options).failed
            if is_dataset(folder) and not failed and not report.is_file():
                failed = evaluate.run(grasps, folder, report, EvaluateConfig(), options).failed
            if failed:
                raise SymgraspError(f"without {rule.key}: {next(iter(failed.values()))}")


def report_of(rule: Rule, folder: Path, out: Path) -> Path:
    """Return the path of the report of a dataset without `rule`."""
    return out / rule.key / f"{folder.name}.json"


def rule_differences(
    rules: Sequence[Rule], datasets: Sequence[Path], out: Path
) -> dict[str, list[Figure]]:
    """Return the figures of each finished rule and its base, over all `datasets` together."""
    runs = {}
    for rule in rules:
        reports = [report_of(rule, folder, out) for folder in datasets]
        if reports and all(path.is_file() for path in reports):
            runs[rule.key] = _run(reports, rule.key)
    pairs = {r.key: [runs[r.base], runs[r.key]] for r in rules if {r.key, r.base} <= runs.keys()}
    config = CompareConfig()
    return {
        key: [figure for figure in compared(pair, config, 0).figures if figure.split == "all"]
        for key, pair in pairs.items()
    }


def _run(reports: Sequence[Path], name: str) -> EvaluatedRun:
    run = read_run(reports[0], name, DEFAULT_ROW)
    for other in reports[1:]:
        read_run(other, name, DEFAULT_ROW, run)
    return run


def page(rules: Sequence[Rule], found: Mapping[str, Sequence[Figure]]) -> str:
    """Return the differences as a Markdown table, after the figures with all rules."""
    rows = [("rule", "left out", *METRICS.values()), ("---", "---", *["---:"] * len(METRICS))]
    for rule in (rule for rule in rules if rule.key in found):
        figures = {figure.metric: figure for figure in found[rule.key]}
        base = "" if rule.base == EVERY_RULE else f" ({rule.base})"
        cells = [_cell(figures.get(metric), rule) for metric in METRICS]
        rows.append((rule.key, f"{rule.meaning}{base}", *cells))
    return f"{NOTE}\n" + "\n".join(f"| {' | '.join(row)} |" for row in rows) + "\n"


def _cell(figure: Figure | None, rule: Rule) -> str:
    if figure is None:
        return "-"
    if rule.key == EVERY_RULE:
        return f"{figure.values[0]:.3f}"
    (difference,) = figure.differences
    if difference.value == 0.0 and difference.low == difference.high:
        return "same"
    if not math.isfinite(difference.low):  # a single scene
        return f"{difference.value:+.4f}"
    return f"{difference.value:+.4f} ({difference.low:+.3f} to {difference.high:+.3f})"


@errors_as_sentences()
def main(arguments: Sequence[str] | None = None) -> None:
    """Measure all rules or the named rules, one after the other."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.leave_one_out", description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--out", type=Path, required=True, metavar="OUT")
    parser.add_argument(
        "--rules", default="", metavar="KEYS", help="separated by commas; default all"
    )
    given = parser.parse_args(arguments)
    rules = rules_named([key for key in given.rules.split(",") if key])
    datasets, memory = [folder for folder in given.folders if is_dataset(folder)], Memory()
    for rule in rules:
        measure(rule, given.folders, given.out, memory)
        text = page(RULES, rule_differences(RULES, datasets, given.out))
        write_text(given.out / "leave_one_out.md", text)
        sys.stdout.write(f"{rule.key}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
