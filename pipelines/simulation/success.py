"""Success rates by split, kind of symmetry and friction, with intervals: the paper's Table III."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pipelines.dataset.graspnet.graspnet_layout import SPLITS
from pipelines.evaluation.reports.tables import SUCCESS_KINDS, Table
from pipelines.evaluation.rows import OURS, ordered_rows, report_row, rows_note
from pipelines.evaluation.runs.records import number_key
from pipelines.evaluation.runs.tallies import ALL
from pipelines.evaluation.runs.trial_records import FORMAT_VERSION, HELD, FrameTrials, TrialRecord
from pipelines.metrics.success_rate import success_rate
from pipelines.simulation.trial import TRIAL_OUTCOMES
from pipelines.storage.files import write_json
from pipelines.storage.provenance import Stamp

Rates = dict[str, dict[str, dict[str, dict[str, Any]]]]
OutcomeCounts = dict[str, dict[str, dict[str, int]]]


def success_rates(
    frames: Sequence[FrameTrials], frictions: Sequence[float], row: str = OURS
) -> Rates:
    """Return the success rates of one method by split, kind and friction."""
    return {
        split: {
            kind: {
                key: _rate([t for t in trials if kind in (ALL, t.kind)], key)
                for key in map(number_key, frictions)
            }
            for kind in SUCCESS_KINDS
        }
        for split, trials in _by_split(frames, row).items()
    }


def outcome_counts(
    frames: Sequence[FrameTrials], frictions: Sequence[float], row: str = OURS
) -> OutcomeCounts:
    """Return the numbers of trials of one method with each outcome, by split and friction."""
    counts: OutcomeCounts = {}
    for split, trials in _by_split(frames, row).items():
        counts[split] = {}
        for key in map(number_key, frictions):
            found = Counter(trial.outcomes[key].reason for trial in trials)
            counts[split][key] = {
                reason: found[reason] for reason in TRIAL_OUTCOMES if found[reason]
            }
    return counts


def write_success(
    path: Path,
    frames: Iterable[FrameTrials],
    frictions: Sequence[float],
    stamp: Stamp,
    failed: Mapping[str, str] | None = None,
) -> None:
    """Write `success.json`: our rates, and in `baselines` the rates of other methods.

    `failed`: scene or model without trials, to reason.
    """
    frames = list(frames)
    rows = ordered_rows({row for frame in frames for row in frame.baselines})
    content = {
        "frictions": list(frictions),
        **_row_content(frames, frictions, OURS),
        "baselines": {row: _row_content(frames, frictions, row) for row in rows},
        **({"failed": dict(failed)} if failed else {}),
        "format_version": FORMAT_VERSION,
        "provenance": stamp.as_json(),
    }
    write_json(path, content)


def success_tables(content: Mapping[str, Any]) -> list[Table]:
    """Return the tables of a `success.json`."""
    frictions = [number_key(friction) for friction in content["frictions"]]
    tables = [_rate_table(content["success"], frictions), _reason_table(content["reasons"])]
    return [*tables, _row_table(content, frictions)] if content.get("baselines") else tables


def _row_content(
    frames: Sequence[FrameTrials], frictions: Sequence[float], row: str
) -> dict[str, Any]:
    return {
        "success": success_rates(frames, frictions, row),
        "reasons": outcome_counts(frames, frictions, row),
    }


def _by_split(frames: Sequence[FrameTrials], row: str) -> dict[str, list[TrialRecord]]:
    splits = [split for split in SPLITS if any(frame.split == split for frame in frames)]
    return {
        split: [
            trial
            for frame in frames
            if split in (ALL, frame.split)
            for trial in frame.rows.get(row, [])
        ]
        for split in (*splits, ALL)
    }


def _rate(trials: Sequence[TrialRecord], key: str) -> dict[str, Any]:
    return success_rate(len(trials), sum(t.outcomes[key].reason == HELD for t in trials))


def _rate_table(success: Mapping[str, Any], frictions: Sequence[str]) -> Table:
    header = ("split", "region", "trials", *(f"mu {friction}" for friction in frictions))
    body = tuple(
        (split, kind, str(rates[frictions[0]]["trials"]), *(_cell(rates[f]) for f in frictions))
        for split, kinds in success.items()
        for kind, rates in kinds.items()
        if rates[frictions[0]]["trials"]
    )
    note = (
        "In brackets: 95 % confidence interval (Wilson), as if all trials were independent; mu is "
        "the fingers' friction."
    )
    return Table("Success in simulation, percent", header, body, note, names=2)


def _row_table(content: Mapping[str, Any], frictions: Sequence[str]) -> Table:
    """Return a table of the rates of all methods by split, over all kinds of symmetry."""
    rows = {OURS: content, **content["baselines"]}
    body = tuple(
        (report_row(row).title, split, *(_cell(kinds[ALL][f]) for f in frictions))
        for row, found in rows.items()
        for split, kinds in found["success"].items()
        if kinds[ALL][frictions[0]]["trials"]
    )
    header = ("method", "split", *(f"mu {friction}" for friction in frictions))
    return Table("Success of all methods, percent", header, body, rows_note(rows), names=2)


def _cell(rate: Mapping[str, float]) -> str:
    return f"{100 * rate['rate']:.0f} [{100 * rate['low']:.0f}-{100 * rate['high']:.0f}]"


def _reason_table(counts: Mapping[str, Any]) -> Table:
    cells = [(s, f, found) for s, by_friction in counts.items() for f, found in by_friction.items()]
    names = [name for name in TRIAL_OUTCOMES if any(found.get(name) for _, _, found in cells)]
    body = tuple(
        (split, friction, *(str(found.get(name, 0)) for name in names))
        for split, friction, found in cells
    )
    return Table("Outcomes of the trials", ("split", "mu", *names), body, names=2)
