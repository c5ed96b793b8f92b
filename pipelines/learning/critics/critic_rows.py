"""`NAME.rows/ROOT/scene_NNNN_CAMERA.h5`: candidates of a scene's frames, for training a critic.

A row is one candidate, with its features and its truth; the rows of one group are the candidates
of one choice, such as the planes of a region.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Indices, Mask, Singles
from pipelines.contents import reading
from pipelines.errors import FormatError
from pipelines.grasping.critics.point_critic import FeatureNames
from pipelines.storage.h5_columns import check_version, read_columns, write_columns
from pipelines.storage.h5_files import new_h5, open_h5
from pipelines.storage.provenance import Stamp

FORMAT_VERSION = 1
FEATURE_COLUMNS = ("points", "shared", "candidates")
COLLECT_AGAIN = "pass --overwrite to collect the candidates again"


@dataclass(frozen=True)
class CriticRows:
    """k candidates.

    Attributes:
        points: (k, n, p) float16, features of the points that a candidate sees; n may be 0.
        shared: (k, s) float32, features that all these points share; s may be 0.
        candidates: (k, c) float32, features of the candidate itself.
        truth: (k,) float32, 0 to 1: whether the candidate is true, or its quality; nan if unknown.
        slot: (k,) int32, symmetry slot of the candidate, -1 without symmetry.
        group: (k,) int64, ascending; the candidates of one choice share a group.
    """

    points: NDArray[np.float16]
    shared: Singles
    candidates: Singles
    truth: Singles
    slot: NDArray[np.int32]
    group: Indices

    @classmethod
    def of_group(
        cls,
        points: NDArray[Any],
        shared: NDArray[Any],
        candidates: NDArray[Any],
        truth: NDArray[Any],
        slot: NDArray[Any],
    ) -> "CriticRows":
        """Return the candidates of one choice, as group 0."""
        return cls(
            points.astype(np.float16),
            shared.astype(np.float32),
            candidates.astype(np.float32),
            truth.astype(np.float32),
            slot.astype(np.int32),
            np.zeros(len(truth), np.int64),
        )

    @classmethod
    def joined(cls, parts: Sequence["CriticRows"]) -> "CriticRows":
        """Return the candidates of all `parts`, at least one; groups of different parts differ."""
        columns = {
            field.name: np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(cls)
        }
        first = np.cumsum([0, *(part.group.max(initial=-1) + 1 for part in parts[:-1])])
        columns["group"] += np.repeat(first, [len(part) for part in parts])
        return cls(**columns)

    @classmethod
    def none(cls, num_points: int, features: FeatureNames) -> "CriticRows":
        """Return an empty set of candidates with `num_points` points each and `features`."""
        return cls.of_group(
            np.zeros((0, num_points, len(features.point))),
            np.zeros((0, len(features.shared))),
            np.zeros((0, len(features.candidate))),
            np.zeros(0),
            np.zeros(0),
        )

    def __len__(self) -> int:
        return len(self.truth)

    def __getitem__(self, index: slice | NDArray[np.integer] | Mask) -> "CriticRows":
        return CriticRows(*(getattr(self, field.name)[index] for field in fields(self)))


COLUMNS = tuple(field.name for field in fields(CriticRows))


def write(path: Path, rows: CriticRows, stamp: Stamp) -> None:
    """Write the candidates of one scene; equal rows and stamps give equal bytes."""
    with new_h5(path) as file:
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["provenance"] = stamp.as_text()
        write_columns(file, {name: getattr(rows, name) for name in COLUMNS}, {})


def read_known(paths: Sequence[Path]) -> CriticRows:
    """Read the candidates with known truth from all files.

    Raises:
        FormatError: a file is damaged, or its features or truths cannot be learned from.
    """
    parts = []
    for path in paths:
        with open_h5(path) as file:
            check_version(path, file.attrs.get("format_version"), FORMAT_VERSION)
            rows = CriticRows(**read_columns(path, file, COLUMNS))
        with reading(path, "a column", COLLECT_AGAIN):
            parts.append(_known(path, rows))
    return CriticRows.joined(parts)


def _known(path: Path, rows: CriticRows) -> CriticRows:
    """Return the rows with known truth; raise FormatError for nan features or truths beyond 1."""
    if len({len(getattr(rows, name)) for name in COLUMNS}) > 1:
        raise FormatError(path, "its columns differ in length", COLLECT_AGAIN)
    known = rows[~np.isnan(rows.truth)]
    if not ((known.truth >= 0.0) & (known.truth <= 1.0)).all():
        raise FormatError(path, "/truth is outside of 0 to 1", COLLECT_AGAIN)
    for name in FEATURE_COLUMNS:
        if not np.isfinite(getattr(known, name)).all():
            raise FormatError(path, f"/{name} is not finite", COLLECT_AGAIN)
    return known
