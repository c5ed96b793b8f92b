"""Settings of the two networks and their trainings."""

from dataclasses import dataclass, field
from typing import Literal

from pipelines.configs.dataset import FRAME_STRIDE, SURROUNDINGS, PackConfig, Surrounding
from pipelines.configs.declaration import BY_EYE, choice, count, fraction, setting
from pipelines.configs.evaluation import EvaluateConfig
from pipelines.configs.inference import InferConfig
from pipelines.configs.planning import ReferenceFrame

DetectorVariant = Literal["light", "resnet50"]
DetectorInput = Literal["geometry", "color", "both"]
PIFTVariant = Literal["spread", "convolution"]
LossVariant = Literal["balanced", "paper"]
ExistenceTarget = Literal["listed", "right"]

MICRO_BATCH_MEANING = (
    "Items of a batch processed together, gradients summed; 0 adapts to the device."
)
LEARNING_RATE = "Learning rate of Adam, at first."
DECAY = "Factor of the learning rate every `decay_epochs` epochs."
DECAY_EPOCHS = "Epochs after which the learning rate drops by the factor `decay`."
EMA_DECAY = "Share of the running mean of the weights that a step keeps; 0 for no mean."
VAL_FRACTION = "Share of the scenes for validation."


@dataclass(frozen=True)
class DetectorConfig:
    """Mask R-CNN with an FPN (Sec. III-D)."""

    variant: DetectorVariant = choice(
        "light", "Backbone: light, or resnet50 as in the paper.", "D. 19"
    )
    input: DetectorInput = choice(
        "geometry", "Channels: geometry (normals and height), color, or both.", "D. 19"
    )
    min_size: int = setting(288, "px", "Shorter side of the training images.", "D. 84", low=32)
    max_size: int = setting(512, "px", "Longer side of the training images.", "D. 84", low=32)
    enlarged: float = setting(
        1.33, "factor", "Image size in use, relative to training.", "D. 84", low=0.1, high=10.0
    )
    max_detections: int = count(40, "Most detections of a frame.", BY_EYE)
    candidate_confidence: float = fraction(
        0.05, "Confidence below which no mask is predicted.", BY_EYE
    )
    min_confidence: float = fraction(0.5, "Least confidence of a detection.", "D. 84")
    mask_threshold: float = fraction(0.5, "Least probability of a mask's pixel.", "torchvision")
    nms_threshold: float = fraction(
        0.5, "Overlap of boxes beyond which the less confident box is dropped.", "torchvision"
    )


@dataclass(frozen=True)
class FinetuneDetectorConfig:
    """Training of the region detector."""

    detector: DetectorConfig = field(default_factory=DetectorConfig)
    epochs: int = count(12, "Passes over the frames.", BY_EYE)
    batch_size: int = count(4, "Frames in a step.", BY_EYE)
    micro_batch_size: int = count(0, MICRO_BATCH_MEANING, "D. 58", low=0)
    learning_rate: float = setting(0.001, "factor", LEARNING_RATE, BY_EYE)
    decay: float = fraction(0.9, DECAY, BY_EYE)
    decay_epochs: float = count(0.5, DECAY_EPOCHS, BY_EYE, low=0.01)
    ema_decay: float = fraction(0.998, EMA_DECAY, BY_EYE)
    min_pixels: int = setting(200, "px", "Pixels below which a region is left out.", BY_EYE, low=1)
    frame_stride: int = count(1, FRAME_STRIDE, BY_EYE)
    max_val_frames: int = count(120, "Most frames of a validation.", BY_EYE)
    val_fraction: float = fraction(0.1, VAL_FRACTION, BY_EYE)


@dataclass(frozen=True)
class NetworkConfig:
    """PointNet++ with PIFT (Sec. III-E, III-G)."""

    input_frame: ReferenceFrame = choice("table", "Axes of the input points.", "D. 69")
    sees_camera: bool = choice(
        True, "Add the direction to the camera at each point to the input.", "D. 140, D. 152"
    )
    num_points: int = count(1500, "Input points of a region.", "Sec. III-G")
    feature_dim: int = count(128, "Features of a point.", "Sec. III-E")
    set_points: tuple[int, int, int, int] = count(
        (384, 128, 32, 8), "Points of each set abstraction level.", BY_EYE
    )
    set_neighbors: tuple[int, int, int, int] = count(
        (16, 16, 16, 32), "Neighbours at each level; all points at the last.", "D. 25"
    )
    set_strides: tuple[int, int, int, int] = count(
        (3, 1, 1, 1),
        "Neighbour stride n of each level: neighbours are among every n-th point.",
        "D. 25",
    )
    use_pift: bool = choice(True, "Deform points before aggregation (Eq. 3).", "Sec. III-E")
    pift: PIFTVariant = choice(
        "spread",
        "F^PIFT: spread, a pooled layer and a power of the cloud's spread; or convolution.",
        "D. 96",
    )
    canonical_frame: bool = choice(
        True,
        "Use the canonical frame of PIFT for input points and symmetries.",
        "D. 83, D. 95",
    )


@dataclass(frozen=True)
class AugmentationConfig:
    """Random changes of a region's cloud in training (Sec. III-E)."""

    turn_deg: float = setting(
        25.0, "deg", "Standard deviation of turns about the up axis, or the view axis.", BY_EYE
    )
    tilt_deg: float = setting(3.0, "deg", "Standard deviation of turns about other axes.", BY_EYE)
    lost_table: float = fraction(
        0.1, "Share of the regions that are used as if no table were known.", "D. 69"
    )
    scale: float = fraction(0.15, "Largest uniform scaling.", BY_EYE)
    mirrored: float = fraction(0.5, "Share of regions that are mirrored.", BY_EYE)
    jitter: float = setting(0.0005, "m", "Standard deviation of each coordinate's noise.", BY_EYE)
    principal_scale: float = setting(
        1.4, "factor", "Largest scale factor, or its inverse, of the Siamese copy.", BY_EYE, low=1.0
    )


@dataclass(frozen=True)
class EndlessConfig:
    """Regions rendered during training."""

    share: float = fraction(
        0.0, "Rendered share of a batch; with packed regions, 0 stands for 0.5.", "D. 59"
    )
    epoch_regions: int = count(20_000, "Regions of an epoch if all are rendered.", BY_EYE)
    surroundings: tuple[Surrounding, ...] = choice(("plain",), SURROUNDINGS, BY_EYE)
    views: int = count(4, "Views of a scene.", "D. 59")
    regions_per_scene: int = count(20, "Regions drawn of a scene.", BY_EYE)
    scenes_together: int = count(16, "Scenes whose regions are shuffled together.", BY_EYE)
    min_objects: int = count(4, "Fewest objects of a scene.", BY_EYE)
    max_objects: int = count(9, "Most objects of a scene.", BY_EYE)
    width: int = setting(640, "px", "Width of the images.", BY_EYE, low=1)
    height: int = setting(480, "px", "Height of the images.", BY_EYE, low=1)
    perfect_share: float = fraction(0.1, "Share of the views without sensor noise.", BY_EYE)
    occluders: float = fraction(
        0.25, "Share of the views with an object in front of the others.", "D. 59"
    )
    mask_leaks: float = fraction(
        0.15, "Share of the masks that include a part of a neighbour.", BY_EYE
    )
    mask_cuts: float = fraction(0.1, "Share of the masks that are cut off.", BY_EYE)
    pack: PackConfig = field(default_factory=PackConfig)


@dataclass(frozen=True)
class TrainConfig:
    """Training of the grasp network (Sec. III-G)."""

    network: NetworkConfig = field(default_factory=NetworkConfig)
    batch_size: int = count(36, "Regions in a step.", "Sec. III-G")
    learning_rate: float = setting(0.001, "factor", LEARNING_RATE, "Sec. III-G")
    decay: float = fraction(0.9, DECAY, "Sec. III-G")
    decay_epochs: float = count(2.0, DECAY_EPOCHS, "Sec. III-G", low=0.01)
    epochs: int = count(40, "Passes over the regions.", BY_EYE)
    weight_feature: float = setting(
        8.0, "weight", "w^f; the paper has 1, with another L^f.", "D. 96"
    )
    weight_affordance: float = setting(1.0, "weight", "w^a.", "Sec. III-G")
    weight_symmetry: float = setting(5.0, "weight", "w^s.", "Sec. III-G")
    weight_existence: float = setting(1.0, "weight", "w^c.", "Sec. III-G")
    weight_parameters: float = setting(5.0, "weight", "w^r.", "Sec. III-G")
    loss: LossVariant = choice(
        "balanced",
        "Terms: balanced, L^f by the features' variance and L^a by class; or paper, as printed.",
        "D. 1, D. 96, D. 113",
    )
    existence: ExistenceTarget = choice(
        "right",
        "Target of existence: listed, the symmetry is labelled; right, also predicted right.",
        "D. 140, D. 152",
    )
    use_siamese: bool = choice(
        True,
        "Train with Siamese consistency: same features in a scaled copy (Fig. 3).",
        "Sec. III-E",
    )
    num_loss_points: int = count(384, "Points of a region for the loss.", "D. 113")
    micro_batch_size: int = count(0, MICRO_BATCH_MEANING, "D. 58", low=0)
    ema_decay: float = fraction(0.998, EMA_DECAY, "D. 113")
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)
    endless: EndlessConfig = field(default_factory=EndlessConfig)
    val_fraction: float = fraction(0.1, VAL_FRACTION, BY_EYE)


@dataclass(frozen=True)
class TrainCriticConfig:
    """Training of the critics of axes, planes and grasps."""

    frame_stride: int = count(1, FRAME_STRIDE, BY_EYE)
    max_grasps: int = count(64, "Most grasps of a region in each pass.", "D. 82")
    epochs: int = count(12, "Passes over the candidates.", BY_EYE)
    batch_size: int = count(256, "Approximate number of candidates in a step.", BY_EYE)
    learning_rate: float = setting(0.002, "factor", LEARNING_RATE, BY_EYE)
    decay: float = fraction(0.9, DECAY, BY_EYE)
    decay_epochs: float = count(0.3, DECAY_EPOCHS, BY_EYE, low=0.01)
    ema_decay: float = fraction(0.998, EMA_DECAY, BY_EYE)
    point_share: float = fraction(0.75, "Share of a candidate's points in a step.", BY_EYE)
    jitter: float = setting(0.01, "factor", "Noise of points, in the unit of the features.", BY_EYE)
    dropout: float = fraction(0.2, "Share of hidden units that are dropped.", BY_EYE)
    weight_choice: float = setting(
        1.0,
        "weight",
        "Loss weight of the choice among a region's grasps, relative to single grasps.",
        "D. 86",
    )
    infer: InferConfig = field(default_factory=InferConfig)
    evaluate: EvaluateConfig = field(default_factory=EvaluateConfig)
