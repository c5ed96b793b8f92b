"""PointNetGPD: PointNet on the points between the fingers of a grasp candidate.

Liang et al.: PointNetGPD: Detecting Grasp Configurations from Point Sets, ICRA 2019. Layers are
as in the authors' release, 1,604,620 parameters for three classes. The light variant sees fewer
points.
"""

import torch
from torch import Tensor, nn

from pipelines.configs.peers import PeerNetworkConfig

CLASSES = 3  # bad, fair, good
HAND_POINTS = {"light": 256, "full": 750}  # points between the fingers


class PointNetGPD(nn.Module):
    """Network from points of the closing region, hand's frame, to log-probabilities of classes."""

    def __init__(self, config: PeerNetworkConfig) -> None:
        super().__init__()
        self.config = config
        self.turn = nn.ModuleList([_of_points(ends_in_relu=True), _of_cloud(9)])
        self.features, self.head = _of_points(ends_in_relu=False), _of_cloud(CLASSES)

    @property
    def num_points(self) -> int:
        """Number of points of a candidate that the network sees."""
        return HAND_POINTS[self.config.variant]

    def forward(
        self,
        points: Tensor,  # (B, N, 3) metres
    ) -> Tensor:
        """Return the log-probabilities (B, 3) of bad, fair and good."""
        columns = points.transpose(1, 2)
        pooled = self.turn[0](columns).amax(dim=2)
        matrix = self.turn[1](pooled).view(-1, 3, 3) + torch.eye(3, device=points.device)
        pooled = self.features((points @ matrix).transpose(1, 2)).amax(dim=2)
        return torch.log_softmax(self.head(pooled), dim=1)


def _of_points(*, ends_in_relu: bool) -> nn.Sequential:
    """Return the layers that all points share, 3 to 1024."""
    layers: list[nn.Module] = []
    for before, after in ((3, 64), (64, 128), (128, 1024)):
        layers += [nn.Conv1d(before, after, 1), nn.BatchNorm1d(after), nn.ReLU()]
    return nn.Sequential(*(layers if ends_in_relu else layers[:-1]))


def _of_cloud(out: int) -> nn.Sequential:
    """Return the layers of a pooled cloud, 1024 to `out`."""
    layers: list[nn.Module] = []
    for before, after in ((1024, 512), (512, 256)):
        layers += [nn.Linear(before, after), nn.BatchNorm1d(after), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(256, out))
