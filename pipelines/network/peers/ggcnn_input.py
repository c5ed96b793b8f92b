"""Input of GG-CNN: depth from its mean, in an image of the size that the network was made for."""

import numpy as np

from pipelines.array_types import Singles

LIMIT = 1.0  # metres from the mean


def normalised(depth: Singles) -> Singles:
    """Return `depth` (h, w), metres, without missing pixels, from its mean, within `LIMIT`."""
    return np.asarray(np.clip(depth - depth.mean(), -LIMIT, LIMIT), np.float32)
