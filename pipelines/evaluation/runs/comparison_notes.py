"""Notes of a comparison: frames left out, and differences in settings and labels."""

from collections.abc import Mapping, Sequence
from typing import Any

from pipelines.contents import mapping_in
from pipelines.errors import counted
from pipelines.evaluation.reports.reports import WITH
from pipelines.evaluation.runs.paired_runs import EvaluatedRun
from pipelines.evaluation.runs.run_readers import DEFAULT_ROW

EVALUATED = {"grasps", "dump"}  # inputs that are evaluated, not labels to evaluate on
# None of these affects our own row; `hands` is the name of the grasp critic's digest in 0.1.
FOR_BASELINES = ("baselines", "seed", "affordance", "grasp_critic", "hands")
# Labels that `evaluate --exact` takes from other files, so that their digests differ anyway.
TAKEN_BY_EXACT = {"meshes", "poses"}
OF_SCENES = {"scenes", "meshes", "poses", "pieces"}  # labels with one digest of all scenes of a run
SEEDED = ("simulate",)  # stages where the seed affects all rows: it cuts models into pieces


def frame_notes(runs: Sequence[EvaluatedRun], paired: int) -> list[str]:
    """Return sentences on the `paired` frames that all `runs` have, and on the frames left out."""
    notes = [f"The {len(runs)} runs are compared on {counted(paired, 'frame')} that all contain."]
    return notes + [
        f"{run.name}: {len(run.frames) - paired} of {counted(len(run.frames), 'frame')} left out, "
        "which not all runs contain."
        for run in runs
        if len(run.frames) > paired
    ]


def setting_notes(runs: Sequence[EvaluatedRun], row: str) -> list[str]:
    """Return a sentence for each difference in settings or labels to the first run."""
    settings, labels = zip(*(_provenance(run, row) for run in runs), strict=True)
    notes = []
    for place, run in enumerate(runs[1:], 1):
        unequal = _differing(settings[0], settings[place])
        changed = [
            f"{name} {settings[place].get(name)} instead of {settings[0].get(name)}"
            for name in unequal
        ]
        if changed:
            notes.append(f"{run.name} was evaluated with other settings: {', '.join(changed)}.")
        other = _differing(labels[0], labels[place])
        if not EVALUATED.intersection(other):
            notes.append(f"{run.name} evaluates the same grasps as {runs[0].name}.")
        if "gripper" in other:
            notes.append(f"{run.name} was evaluated with another gripper.")
        unknown = TAKEN_BY_EXACT if "exact" in unequal else set()
        other = [name for name in other if _is_label(name) and name not in unknown]
        if _scenes(run) != _scenes(runs[0]) and (unsure := OF_SCENES.intersection(other)):
            other = [name for name in other if name not in unsure]
            notes.append(
                f"{run.name} has other scenes than {runs[0].name}, so whether labels of common "
                f"scenes are the same is not known: {', '.join(sorted(unsure))}."
            )
        if other:
            notes.append(f"{run.name} was evaluated on other labels: {', '.join(other)}.")
    return notes


def _scenes(run: EvaluatedRun) -> set[str]:
    """Return the scenes of a run: the names of its frames without their numbers."""
    return {name.rpartition("/")[0] for name in run.frames}


def _is_label(name: str) -> bool:
    """Return whether an input of an evaluation is its truth, not grasps or a gripper."""
    return name not in {*EVALUATED, "gripper"} and not name.startswith(WITH)


def _provenance(run: EvaluatedRun, row: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the settings and the digests of inputs of `row` of a report."""
    stamp = mapping_in(run.report, "provenance")
    unused = set(FOR_BASELINES if row == DEFAULT_ROW else ())
    unused -= {"seed"} if stamp.get("stage") in SEEDED else set()
    settings = {**mapping_in(stamp, "config"), "seed": stamp.get("seed")}
    settings["version"] = stamp.get("version")
    groups = (settings, mapping_in(stamp, "inputs"))
    used = [{name: value for name, value in g.items() if name not in unused} for g in groups]
    return used[0], used[1]


def _differing(first: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    return [name for name in sorted({*first, *other}) if first.get(name) != other.get(name)]
