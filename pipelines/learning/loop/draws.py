"""Random generators that depend on the seed and on epoch, step and item alone.

So a training that is resumed, of several processes, or of other micro-batches draws the same
numbers.
"""

import numpy as np

TRAINING = 1_000_003  # keeps trainings apart from datasets that draw from the same seed


def generator(seed: int, *place: int) -> np.random.Generator:
    """Return the generator of one place of a training, `place` counted from 0."""
    # A spawn key, unlike a longer seed, distinguishes (1,) from (1, 0).
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(TRAINING, *place)))
