"""1 x 1 convolutions as matrix products, for maps whose channels lie together in memory.

torch's own convolution, on one thread, first copies such maps into another layout.
"""

from torch import Tensor, nn

from pipelines.network.cpu.products import linear


class Pointwise(nn.Module):
    """A 1 x 1 convolution of `channels_last` maps, for inference alone."""

    def __init__(self, convolution: nn.Conv2d) -> None:
        super().__init__()
        self.weight, self.bias = convolution.weight.flatten(1), convolution.bias

    def forward(
        self,
        image: Tensor,  # (B, C, h, w)
    ) -> Tensor:
        """Return (B, D, h, w), the output of the convolution."""
        places = image.movedim(1, -1)
        made = linear(places.flatten(0, -2), self.weight, self.bias)
        return made.view(*places.shape[:-1], len(self.weight)).movedim(-1, 1)


def replace_pointwise(network: nn.Module) -> None:
    """Replace each 1 x 1 convolution of stride 1 of a trained network by a matrix product."""
    for module in list(network.modules()):
        for name, layer in module.named_children():
            if isinstance(layer, nn.Conv2d) and layer.kernel_size == layer.stride == (1, 1):
                setattr(module, name, Pointwise(layer))
