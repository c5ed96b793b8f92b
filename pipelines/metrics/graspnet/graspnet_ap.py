"""Average precision as graspnetAPI counts it: suppression, ranking, accuracy of the first k.

A frame's grasps are thinned by greedy suppression; the ten most confident on each object stay,
and of these all that are at least as confident as the 50th. The accuracy at rank k and friction mu
is the share of the first k grasps that holds at mu, k = 1..50; missing grasps count as failed. AP
is the mean over frames, ranks and frictions. Where confidences tie, the file's order decides; in
graspnetAPI the order of ties is undefined, as its sorts are unstable.
"""

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array, Indices, Mask

AP_FRICTIONS = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)
AP_FIGURES = {"ap": AP_FRICTIONS, "ap_0.8": (0.8,), "ap_0.4": (0.4,)}  # name to frictions
RANKS = 50  # grasps of a frame that count
PER_OBJECT = 10
NMS_DISTANCE = 0.03  # metres
NMS_ANGLE = np.radians(30.0)
AT_A_TIME = 256  # grasps in one step of the suppression
FAILED = -1.0  # the friction of a grasp that holds at no friction


def suppress(confidence: ArrayLike, rotation: Array, translation: Array) -> Indices:
    """Return the indices (k,) of the grasps that stay, most confident first.

    A grasp is removed if a more confident grasp that stays is nearer than 3 cm and turned by less
    than 30 degrees; a gripper turned by half a turn about its approach is another grasp here.
    `confidence`: (n,), higher is better. `rotation`: (n, 3, 3). `translation`: (n, 3) metres.
    """
    order = np.argsort(-np.asarray(confidence), kind="stable")
    kept = order[:0]
    for start in range(0, len(order), AT_A_TIME):
        some = order[start : start + AT_A_TIME]
        some = some[~_near(rotation, translation, some, kept).any(axis=1)]
        near = _near(rotation, translation, some, some)
        stays = np.ones(len(some), np.bool_)
        for better in range(len(some)):
            if stays[better]:
                stays[better + 1 :] &= ~near[better, better + 1 :]
        kept = np.concatenate([kept, some[stays]])
    return np.asarray(kept, np.int64)


def _near(rotation: Array, translation: Array, these: Indices, those: Indices) -> Mask:
    """Return (n, m) whether a grasp of `these` (n,) and one of `those` (m,) are too near."""
    pairs = zip(translation[these].T, translation[those].T, strict=True)
    x, y, z = [np.square(a[:, None] - b) for a, b in pairs]
    near: Mask = np.sqrt(x + y + z) < NMS_DISTANCE
    this, that = np.nonzero(near)
    trace = np.einsum("nij,nij->n", rotation[these[this]], rotation[those[that]])
    near[this, that] = np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)) < NMS_ANGLE
    return near


def ranked(confidence: Array, owner: Indices) -> Indices:
    """Return the indices (k,) of the grasps that count, most confident first.

    `confidence`: (n,), in descending order. `owner`: (n,) the object of each grasp.
    """
    chosen = [np.flatnonzero(owner == each)[:PER_OBJECT] for each in np.unique(owner)]
    index = np.sort(np.concatenate(chosen)) if chosen else np.zeros(0, np.int64)
    last = confidence[index[min(RANKS, len(index)) - 1]] if len(index) else 0.0
    return np.asarray(index[confidence[index] >= last])


def accuracy(friction: ArrayLike) -> Array:
    """Return (50, 6) the share of the first k grasps that holds, by rank and by `AP_FRICTIONS`.

    `friction`: (n,) smallest friction at which each ranked grasp holds, `FAILED` if none.
    """
    found = np.full(RANKS, FAILED)
    first = np.asarray(friction, np.float64)[:RANKS]
    found[: len(first)] = first
    holds = (found[:, None] > 0.0) & (found[:, None] <= np.asarray(AP_FRICTIONS))
    return np.asarray(np.cumsum(holds, axis=0) / np.arange(1, RANKS + 1)[:, None])


def ap_figures(by_friction: ArrayLike) -> dict[str, float]:
    """Return `AP_FIGURES`, given the mean accuracy (6,) at each of `AP_FRICTIONS`."""
    found = dict(zip(AP_FRICTIONS, np.asarray(by_friction, np.float64).tolist(), strict=True))
    return {name: float(np.mean([found[mu] for mu in mus])) for name, mus in AP_FIGURES.items()}
