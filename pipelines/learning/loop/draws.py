"""Random numbers that depend on seed and place alone: epoch, step, item.

So a training that is resumed, or shared out among processes, or cut into other micro-batches,
draws what it would have drawn anyway.
"""

import numpy as np

TRAINING = 1_000_003  # what a training draws is apart from what datasets draw of the same seed


def generator(seed: int, *place: int) -> np.random.Generator:
    """Return the generator of one place of a training, `place` counted from 0."""
    # A spawn key, unlike a longer seed, tells (1,) from (1, 0).
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(TRAINING, *place)))
