"""The geometry stream of a detector of two streams, as a separate detector.

`python -m tools.gpu_training.geometry_stream BOTH.safetensors OUT.safetensors` writes it. A mean
colour adds nearly the same values everywhere but at the image's border; the biases include them.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import cast

import torch

from pipelines.configs import DetectorConfig
from pipelines.errors import ValueRangeError, errors_as_sentences
from pipelines.network.detection.backbone import TwoStreamBackbone
from pipelines.network.detection.detector import MODEL_NAME
from pipelines.network.detection.mask_rcnn import build_detector
from pipelines.network.weights_files import fill, read_weights, weights_metadata
from pipelines.storage.checkpoints import save_weights

SIDE = 512  # pixels of an image with the middle far from the border
COLOR_PARTS = ("backbone.color.", "backbone.joins.")


@torch.inference_mode()
def write(both: Path, out: Path) -> None:
    """Write the geometry stream of the weights `both`.

    Raises:
        ValueRangeError: the weights are not of two streams.
    """
    tensors, config = read_weights(both, MODEL_NAME, DetectorConfig)
    if config.input != "both":
        raise ValueRangeError("input of the detector", config.input, "both")
    detector = build_detector(config).eval()
    fill(detector, tensors, both)
    backbone = cast(TwoStreamBackbone, detector.backbone)
    gray = torch.zeros(1, backbone.color_channels, SIDE, SIDE)
    kept = {name: each for name, each in tensors.items() if not name.startswith(COLOR_PARTS)}
    for level, (map_, join) in enumerate(
        zip(backbone.color.maps(gray), backbone.joins, strict=True)
    ):
        middle = map_.shape[-1] // 2
        added = join(map_)[0, :, middle, middle]
        name = f"backbone.pyramid.inner_blocks.{level}.0"
        kept[f"{name}.bias"] = kept[f"{name}.bias"] + kept[f"{name}.weight"][:, :, 0, 0] @ added
    save_weights(out, kept, weights_metadata(MODEL_NAME, replace(config, input="geometry")))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("both", type=Path)
    parser.add_argument("out", type=Path)
    with errors_as_sentences():
        write(**vars(parser.parse_args()))
