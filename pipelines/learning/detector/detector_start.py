"""The detector that a training starts from: fresh, COCO's, or an earlier training's."""

import logging
from pathlib import Path

import torch
from torchvision.models.detection import MaskRCNN

from pipelines.configs import DetectorConfig, FinetuneDetectorConfig
from pipelines.errors import FormatError, SymgraspError, ValueRangeError
from pipelines.network.detection.detector import MODEL_NAME
from pipelines.network.detection.mask_rcnn import adopt_coco, build_detector
from pipelines.network.weights_files import fill, read_weights
from pipelines.storage.torch_weights import read_torch_weights

log = logging.getLogger(__name__)

GEOMETRY_ALONE = "--variant light --input geometry"
BOTH_STREAMS = "--variant light --input both"


def starting_detector(
    config: FinetuneDetectorConfig,
    seed: int,
    coco_weights: str | None = None,
    init: Path | None = None,
) -> MaskRCNN:
    """Return the detector to start from, with COCO's weights or the weights of `init`, if given.

    A light detector of colour and geometry may start from a detector of geometry; its colour stream
    then starts from random weights.

    Raises:
        ValueRangeError: COCO weights are requested for a variant that has none.
        FormatError: `init` holds no weights of this detector, or `coco_weights` no COCO weights.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)  # layers are initialised from torch's own generator
        model = build_detector(config.detector)
    if coco_weights is not None:
        if config.detector.variant != "resnet50":
            expected = "left out unless --variant resnet50"
            raise ValueRangeError("--coco-weights", coco_weights, expected)
        fresh = adopt_coco(model, read_coco(coco_weights), coco_weights)
        log.info("%d tensors start from random values, the others from COCO", len(fresh))
    if init is not None:
        tensors, settings = read_weights(init, MODEL_NAME, DetectorConfig)
        found, wanted = _kind(settings), _kind(config.detector)
        if (found, wanted) == (GEOMETRY_ALONE, BOTH_STREAMS):
            tensors = model.state_dict() | tensors
        elif found != wanted:
            raise FormatError(init, f"is of a detector with {found}", f"{wanted} is needed")
        fill(model, tensors, init)
    return model


def _kind(config: DetectorConfig) -> str:
    return f"--variant {config.variant} --input {config.input}"


def read_coco(source: str) -> dict[str, torch.Tensor]:
    """Return torchvision's COCO weights from a file, or from its hub for `download`."""
    if source != "download":
        return read_torch_weights(Path(source))
    from torchvision.models.detection import MaskRCNN_ResNet50_FPN_Weights  # noqa: PLC0415

    weights = MaskRCNN_ResNet50_FPN_Weights.COCO_V1
    log.warning("downloading COCO weights from %s", weights.url)
    try:
        return dict(weights.get_state_dict(progress=False, check_hash=True))
    except OSError as error:
        raise SymgraspError(
            f"{weights.url} cannot be reached ({error}); give --coco-weights a copy of the file"
        ) from error
