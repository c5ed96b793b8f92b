"""Farthest and nearest points of a cloud, compiled, by a search over all points.

A row of distances is a sum over three columns. Its counts, minima and places are sums and minima of
integers, since the bits of non-negative numbers have the same order as the numbers. A processor
does eight or sixteen of these at once, so that a search over all points is faster than to build a
tree. Distances are compared in single precision; of equally far points the first are taken.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipelines.array_types import Floats, Indices, Singles
from pipelines.geometry.numerics.compiled import compiled
from pipelines.network.cpu.cloudwise import each_cloud

NO_PLACE = np.int32(np.iinfo(np.int32).max)
TRIES = 6  # to find a distance with as many points as needed within it, and few more
FEW = 8  # points more than needed within such a distance


def fast_farthest_points(
    points: Tensor,  # (B, N, 3)
    count: int,
) -> Tensor:
    """Return indices (B, count), as `network.sampling.farthest_points` does, a thread per cloud."""
    chosen = torch.empty(len(points), count, dtype=torch.int64)
    each_cloud(find_farthest, points.float(), chosen)
    return chosen


def fast_nearest_neighbors(
    queries: Tensor,  # (B, M, 3)
    support: Tensor,  # (B, N, 3)
    count: int,
) -> Tensor:
    """Return indices (B, M, count), as `network.sampling.nearest_neighbors` does."""
    index = torch.empty(*queries.shape[:2], min(count, support.shape[1]), dtype=torch.int64)
    each_cloud(find_nearest, queries.float(), support.float(), index)
    return index


def fast_three_nearest(
    queries: Tensor,  # (B, M, 3)
    support: Tensor,  # (B, N, 3)
) -> tuple[Tensor, Tensor]:
    """Return indices and squared distances (B, M, 3) of the nearest points.

    If there are fewer than three points, any point stands for the missing ones, infinitely far.
    """
    index = queries.new_empty(*queries.shape[:2], 3, dtype=torch.int64)
    squared = queries.new_empty(index.shape)
    each_cloud(find_three_nearest, queries, support, index, squared)
    return index, squared


@compiled
def find_farthest(cloud: Singles, chosen: Indices) -> None:
    """Set `chosen` (m,) to the first of a cloud's points (n, 3), then always the farthest point."""
    xs, ys, zs = cloud[:, 0].copy(), cloud[:, 1].copy(), cloud[:, 2].copy()
    squared = np.full(len(cloud), np.float32(np.inf))
    fresh = np.empty_like(squared)
    chosen[0] = 0
    for m in range(1, len(chosen)):
        _measure(cloud[chosen[m - 1]], xs, ys, zs, fresh)
        for n in range(len(squared)):
            squared[n] = min(fresh[n], squared[n])
        bits = squared.view(np.int32)
        most = bits[0]
        for n in range(len(bits)):
            most = max(most, bits[n])
        chosen[m] = _first(bits, most)


@compiled
def find_nearest(queries: Singles, support: Singles, places: Indices) -> None:
    """Set `places` (m, k) to the points (n, 3) nearest to each query (m, 3), the nearest first.

    There are at least k points.
    """
    xs, ys, zs = support[:, 0].copy(), support[:, 1].copy(), support[:, 2].copy()
    squared = np.empty(len(support), np.float32)
    within = np.empty(len(support) + 1, np.int64)
    near, count = np.zeros(places.shape[1], np.int64), places.shape[1]
    limit = np.float32(0.0)
    for m in range(len(queries)):
        _measure(queries[m], xs, ys, zs, squared)
        limit = _limit_of_some(squared, count, limit)
        found = 0
        for n in range(len(squared)):
            within[found] = n
            found += 1 if squared[n] <= limit else 0
        for f in range(found):
            place = within[f]
            k = min(f, count)
            while k > 0 and squared[place] < squared[near[k - 1]]:
                if k < count:
                    near[k] = near[k - 1]
                k -= 1
            if k < count:
                near[k] = place
        for k in range(count):
            places[m, k] = near[k]


@compiled
def find_three_nearest(
    queries: Floats, support: Floats, places: Indices, squared_gaps: Floats
) -> None:
    """Set `places` (m, 3) to the points (n, 3) nearest to each query, and `squared_gaps` likewise.

    Distances are compared in single precision and returned in the precision of the points. If n is
    less than 3, any point stands for the missing ones, infinitely far.
    """
    single, queried = support.astype(np.float32), queries.astype(np.float32)
    xs, ys, zs = single[:, 0].copy(), single[:, 1].copy(), single[:, 2].copy()
    squared = np.empty(len(support), np.float32)
    bits = squared.view(np.int32)
    for m in range(len(queries)):
        _measure(queried[m], xs, ys, zs, squared)
        for k in range(3):
            least = bits[0]
            for n in range(len(bits)):
                least = min(least, bits[n])
            place = _first(bits, least)
            squared_gaps[m, k] = np.inf
            if k < len(bits):
                x = support[place, 0] - queries[m, 0]
                y = support[place, 1] - queries[m, 1]
                z = support[place, 2] - queries[m, 2]
                squared_gaps[m, k] = x * x + y * y + z * z
            places[m, k], squared[place] = place, np.inf


@compiled
def _measure(query: Singles, xs: Singles, ys: Singles, zs: Singles, squared: Singles) -> None:
    """Set `squared` (n,) to the squared distances from the `query` (3,) to points (n,) each."""
    for n in range(len(squared)):
        x, y, z = xs[n] - query[0], ys[n] - query[1], zs[n] - query[2]
        squared[n] = x * x + y * y + z * z


@compiled
def _first(bits: NDArray[np.int32], wanted: np.int32) -> int:
    """Return the first index at which `bits` (n,) equal `wanted`."""
    place = NO_PLACE
    for n in range(len(bits)):
        place = min(place, np.int32(n) if bits[n] == wanted else NO_PLACE)
    return int(place)


@compiled
def _limit_of_some(squared: Singles, count: int, guess: np.float32) -> np.float32:
    """Return a bound with at least `count` of `squared` (n,) within it, and few more if possible.

    The number of points of a surface grows with the square of the distance. `guess`: the bound of
    the previous query, which is similar; 0 for none.
    """
    low, high = np.float32(0.0), np.float32(np.inf)
    if not low < guess < high:
        guess = squared.max() * np.float32(count / len(squared))
    for _ in range(TRIES):
        found = 0
        for n in range(len(squared)):
            found += 1 if squared[n] <= guess else 0
        if found < count:
            low = guess
        elif found > count + FEW:
            high = guess
        else:
            return guess
        guess *= np.float32((count + 0.5 * FEW) / max(found, 1))
        if not low < guess < high:
            guess = np.float32(0.5) * (low + high)
    return high
