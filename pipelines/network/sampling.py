"""Which points a layer looks at: farthest points, nearest neighbours, three-nearest weights.

On the CPU compiled code answers (fpsample, OpenCV's KD-tree, which is exact and works in single
precision, and for three neighbours a loop of ours), one cloud a thread; elsewhere plain torch does.
Nothing here has a gradient: indices do not, and interpolation weights are of fixed points.
"""

import cv2
import fpsample
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from pipelines.network.cloudwise import each_cloud
from pipelines.network.interpolation import TINY, find_three_nearest, interpolated

Places = NDArray[np.int64]

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

    def sample(cloud: NDArray[np.float32], out: Places) -> None:
        out[:] = fpsample.bucket_fps_kdline_sampling(cloud, count, h=height, start_idx=0)

    chosen = torch.empty(len(points), count, dtype=torch.int64)
    each_cloud(sample, points.float(), chosen)
    return chosen


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
    if queries.device.type != "cpu" or support.shape[1] <= SMALL_SUPPORT:
        return _nearest_torch(queries, support, count)[1]

    def search(at: NDArray[np.float32], cloud: NDArray[np.float32], out: Places) -> None:
        out[:] = cv2.flann.Index(cloud, KD_TREE).knnSearch(at, out.shape[1])[0]

    index = torch.empty(*queries.shape[:2], min(count, support.shape[1]), dtype=torch.int64)
    each_cloud(search, queries.float(), support.float(), index)
    return index


@torch.no_grad()
def three_nearest(
    queries: Tensor,  # (B, M, 3)
    support: Tensor,  # (B, N, 3)
) -> tuple[Tensor, Tensor]:
    """Return indices and weights (B, M, 3) that interpolate from `support` at `queries`.

    Weights are inverse squared distances that sum to one, as PointNet++ has them. Where there are
    fewer than three points, weights of zero (on a CPU) or fewer columns take the others' place.
    """
    if queries.device.type == "cpu":
        index = queries.new_empty(*queries.shape[:2], 3, dtype=torch.int64)
        weight = queries.new_empty(index.shape)
        each_cloud(find_three_nearest, queries, support, index, weight)
        return index, weight
    squared_distance, index = _nearest_torch(queries, support, 3)
    weight = 1.0 / (squared_distance + TINY)
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
    if values.device.type == "cpu":
        return interpolated(values, index, weight)
    bags = _flat(values, index).reshape(-1, index.shape[2])
    summed = functional.embedding_bag(
        bags, values.flatten(0, 1), per_sample_weights=weight.flatten(0, 1), mode="sum"
    )
    return summed.view(len(values), index.shape[1], values.shape[2])


def _flat(values: Tensor, index: Tensor) -> Tensor:
    """Return indices (B, ...) into the clouds of `values` laid end to end."""
    start = torch.arange(len(values), device=values.device) * values.shape[1]
    return index + start.view(-1, *[1] * (index.dim() - 1))


def _nearest_torch(queries: Tensor, support: Tensor, count: int) -> tuple[Tensor, Tensor]:
    squared = (queries[:, :, None] - support[:, None]).square().sum(-1)
    distance, index = squared.topk(min(count, support.shape[1]), dim=-1, largest=False)
    return distance, index
