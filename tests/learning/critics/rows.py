"""Rows of made-up candidates; one coordinate of their points determines their truth."""

import numpy as np

from pipelines.learning.critics.critic_rows import CriticRows
from pipelines.learning.critics.kinds import CriticKind


def made_rows(kind: CriticKind, groups=60, size=10, seed=0, num_points=8) -> CriticRows:
    """Return `groups` of `size` candidates each; a critic of `kind` can learn their truth."""
    rng, features = np.random.default_rng(seed), kind.features
    count = groups * size
    points = rng.normal(size=(count, num_points, len(features.point)))
    parts = [
        points,
        rng.normal(size=(count, len(features.shared))),
        rng.normal(size=(count, len(features.candidate))),
        np.clip(0.5 + 0.5 * points[:, :, 0].mean(axis=1), 0, 1),
        np.zeros(count),
    ]
    return CriticRows.joined(
        [
            CriticRows.of_group(*(part[start : start + size] for part in parts))
            for start in range(0, count, size)
        ]
    )
