"""Which points a layer looks at: farthest points, nearest neighbours, three-nearest weights.

On the CPU compiled libraries answer (fpsample, OpenCV's KD-tree, which is exact and works in
single precision), one cloud a thread; elsewhere plain torch does, so that both devices need no
compiled operator of ours. Nothing here has a
gradient: indices do not, and interpolation weights are of fixed points.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import cv2
import fpsample
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

# Below these sizes one batched tensor operation is quicker than a call for each cloud.
SMALL_CLOUD = 96
SMALL_SUPPORT = 48
KD_TREE: dict[str, bool | int | float | str] = {"algorithm": 4}  # FLANN's number of its exact tree


@torch.no_grad()
def farthest_points(
    points: Tensor,  # (B, N, 3)
    count: int,
) -> Tensor:
    """Return indices (B, count) of points far from each other, the same ones each time.

    After a first point (D. 62), each next one is the farthest from all that were chosen before.
    """
    if count >= points.shape[1]:
        return torch.arange(points.shape[1], device=points.device).expand(points.shape[:2])
    if points.device.type != "cpu" or points.shape[1] <= SMALL_CLOUD:
        return _farthest_points_torch(points, count)
    height = 3 if points.shape[1] < 1024 else 4  # of fpsample's tree, the quickest when tried

    def sample(cloud: NDArray[np.float32]) -> NDArray[np.int64]:
        chosen = fpsample.bucket_fps_kdline_sampling(cloud, count, h=height, start_idx=0)
        return np.asarray(chosen, np.int64)

    return _each_cloud(sample, points)


def _farthest_points_torch(points: Tensor, count: int) -> Tensor:
    batch = torch.arange(len(points), device=points.device)
    chosen = torch.zeros(len(points), count, dtype=torch.int64, device=points.device)
    distance = torch.full(points.shape[:2], torch.inf, device=points.device)
    for i in range(1, count):
        offset = points - points[batch, chosen[:, i - 1]][:, None]
        distance = torch.minimum(distance, offset.square().sum(-1))
        chosen[:, i] = distance.argmax(-1)
    return chosen


@torch.no_grad()
def nearest_neighbors(
    queries: Tensor,  # (B, M, 3)
    support: Tensor,  # (B, N, 3)
    count: int,
) -> Tensor:
    """Return indices (B, M, min(count, N)) of the support points nearest to each query."""
    return _nearest(queries, support, count)[1]


@torch.no_grad()
def three_nearest(
    queries: Tensor,  # (B, M, 3)
    support: Tensor,  # (B, N, 3)
) -> tuple[Tensor, Tensor]:
    """Return indices and weights (B, M, 3) that interpolate from `support` at `queries`.

    Weights are inverse squared distances that sum to one, as PointNet++ has them.
    """
    squared_distance, index = _nearest(queries, support, 3)
    weight = 1.0 / (squared_distance + 1e-8)
    return index, weight / weight.sum(-1, keepdim=True)


def gather(
    values: Tensor,  # (B, N, C)
    index: Tensor,  # (B, ...)
) -> Tensor:
    """Return `values` (B, ..., C) at `index`, cloud by cloud."""
    picked = values.flatten(0, 1).index_select(0, _flat(values, index).reshape(-1))
    return picked.view(*index.shape, values.shape[2])


def weighted_sum(
    values: Tensor,  # (B, N, C)
    index: Tensor,  # (B, M, K)
    weight: Tensor,  # (B, M, K)
) -> Tensor:
    """Return sums (B, M, C) of `values` at `index`, each times its `weight`."""
    bags = _flat(values, index).reshape(-1, index.shape[2])
    summed = functional.embedding_bag(
        bags, values.flatten(0, 1), per_sample_weights=weight.flatten(0, 1), mode="sum"
    )
    return summed.view(len(values), index.shape[1], values.shape[2])


def _flat(values: Tensor, index: Tensor) -> Tensor:
    """Return indices (B, ...) into the clouds of `values` laid end to end."""
    start = torch.arange(len(values), device=values.device) * values.shape[1]
    return index + start.view(-1, *[1] * (index.dim() - 1))


def _nearest(queries: Tensor, support: Tensor, count: int) -> tuple[Tensor, Tensor]:
    count = min(count, support.shape[1])
    if queries.device.type != "cpu" or support.shape[1] <= SMALL_SUPPORT:
        return _nearest_torch(queries, support, count)

    def search(cloud: NDArray[np.float32], at: NDArray[np.float32]) -> NDArray[np.int64]:
        return np.asarray(cv2.flann.Index(cloud, KD_TREE).knnSearch(at, count)[0], np.int64)

    index = _each_cloud(search, support, queries)
    return (queries[:, :, None] - gather(support, index)).square().sum(-1), index


def _nearest_torch(queries: Tensor, support: Tensor, count: int) -> tuple[Tensor, Tensor]:
    squared = (queries[:, :, None] - support[:, None]).square().sum(-1)
    distance, index = squared.topk(count, dim=-1, largest=False)
    return distance, index


def _each_cloud(function: Callable[..., NDArray[np.int64]], *clouds: Tensor) -> Tensor:
    """Apply `function` to the i-th cloud of each tensor, clouds in parallel; stack the answers."""
    arrays = [cloud.detach().float().contiguous().numpy() for cloud in clouds]
    threads = min(torch.get_num_threads(), len(arrays[0]))
    if threads == 1:
        return torch.from_numpy(np.stack([function(*each) for each in zip(*arrays, strict=True)]))
    with ThreadPoolExecutor(threads) as pool:
        return torch.from_numpy(np.stack(list(pool.map(function, *arrays))))
