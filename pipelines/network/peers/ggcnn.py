"""GG-CNN and GG-CNN2: grasp quality, angle and opening at every pixel of a depth image.

Morrison, Corke, Leitner: Closing the Loop for Robotic Grasping, RSS 2018. Layers and sizes are
as in the authors' release: 62,420 and 66,676 parameters.
"""

from collections.abc import Callable

from torch import Tensor, nn

from pipelines.configs.peers import PeerNetworkConfig

MAPS = ("quality", "cos", "sin", "width")  # in the order of the output's channels
SIDES_BY = {"light": 12, "full": 4}  # sides of an image are multiples of this number


class GGCNN(nn.Module):
    """One channel of depth in, the four `MAPS` out, at the same size."""

    def __init__(self, config: PeerNetworkConfig) -> None:
        super().__init__()
        self.config = config
        layers, width, kernel = _LAYERS[config.variant]()
        self.body = nn.Sequential(*layers)
        self.heads = nn.Conv2d(width, len(MAPS), kernel)  # one pass over the features for all maps
        for layer in self.modules():
            if isinstance(layer, nn.Conv2d | nn.ConvTranspose2d):
                nn.init.constant_(layer.state_dict()["bias"], 0.0)
                if layer is not self.heads:
                    nn.init.xavier_uniform_(layer.weight)
        for i in range(len(MAPS)):
            nn.init.xavier_uniform_(self.heads.weight.data[i : i + 1])

    def forward(
        self,
        depth: Tensor,  # (B, 1, h, w) metres from the mean; sides by `SIDES_BY`
    ) -> Tensor:
        """Return the maps (B, 4, h, w), in the order of `MAPS`."""
        maps: Tensor = self.heads(self.body(depth))
        return maps


def _first() -> tuple[list[nn.Module], int, int]:
    """Return the layers of GG-CNN, the width of the last layer and the heads' kernel size."""
    layers: list[nn.Module] = []
    for before, after, kernel, stride, padding in (
        (1, 32, 9, 3, 3),
        (32, 16, 5, 2, 2),
        (16, 8, 3, 2, 1),
    ):
        layers += [nn.Conv2d(before, after, kernel, stride, padding), nn.ReLU()]
    for before, after, kernel, stride, padding in (
        (8, 8, 3, 2, 1),
        (8, 16, 5, 2, 2),
        (16, 32, 9, 3, 3),
    ):
        layers += [
            nn.ConvTranspose2d(before, after, kernel, stride, padding, output_padding=1),
            nn.ReLU(),
        ]
    return layers, 32, 2


def _second() -> tuple[list[nn.Module], int, int]:
    """Return the layers, last width and heads' kernel size of GG-CNN2."""

    def conv(before: int, after: int, kernel: int, dilation: int = 1) -> list[nn.Module]:
        padding = dilation * (kernel // 2)
        return [nn.Conv2d(before, after, kernel, padding=padding, dilation=dilation), nn.ReLU()]

    def up() -> nn.Module:
        return nn.Upsample(scale_factor=2, mode="bilinear", align_corners=False)

    layers = [*conv(1, 16, 11), *conv(16, 16, 5), nn.MaxPool2d(2)]
    layers += [*conv(16, 16, 5), *conv(16, 16, 5), nn.MaxPool2d(2)]
    layers += [*conv(16, 32, 5, 2), *conv(32, 32, 5, 4)]
    layers += [up(), *conv(32, 16, 3), up(), *conv(16, 16, 3)]
    return layers, 16, 1


_LAYERS: dict[str, Callable[[], tuple[list[nn.Module], int, int]]] = {
    "light": _first,
    "full": _second,
}
