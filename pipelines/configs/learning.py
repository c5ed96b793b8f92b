"""The two networks and their trainings."""

from dataclasses import dataclass, field

from pipelines.configs.dataset import PackConfig


@dataclass(frozen=True)
class DetectorConfig:
    """Mask R-CNN with an FPN (Sec. III-D)."""

    variant: str = "light"  # or resnet50
    input: str = "geometry"  # or color, both
    min_size: int = 288  # pixels, shorter side at the network's input while it is trained
    max_size: int = 512  # and the longer one
    enlarged: float = 1.33  # times that size in use: training looks closer too; D. 84
    max_detections: int = 40
    candidate_confidence: float = 0.05  # below, regions are not even drawn for figures
    min_confidence: float = 0.5
    mask_threshold: float = 0.5
    nms_threshold: float = 0.5


@dataclass(frozen=True)
class FinetuneDetectorConfig:
    """Training of the region detector."""

    detector: DetectorConfig = field(default_factory=DetectorConfig)
    epochs: int = 12
    batch_size: int = 4
    micro_batch_size: int = 0  # gradients are accumulated to `batch_size`; 0: by device, D. 58
    learning_rate: float = 0.001
    decay: float = 0.9  # every `decay_epochs` epochs
    decay_epochs: float = 0.5
    ema_decay: float = 0.998  # of the running mean of the weights that is kept
    min_pixels: int = 200  # smaller region masks are not trained on
    frame_stride: int = 1  # every how many-th frame of a scene is used
    max_val_frames: int = 120  # that one validation looks at
    val_fraction: float = 0.1  # of the scenes


@dataclass(frozen=True)
class NetworkConfig:
    """PointNet++ with PIFT (Sec. III-E, III-G)."""

    input_frame: str = "table"  # or camera; D. 69
    num_points: int = 1500
    feature_dim: int = 128
    set_points: tuple[int, int, int, int] = (384, 128, 32, 8)
    set_neighbors: tuple[int, int, int, int] = (16, 16, 16, 32)  # the last: all of its level
    set_strides: tuple[int, int, int, int] = (3, 1, 1, 1)  # every how many-th point is a neighbour
    use_pift: bool = True  # Table IV, "No PIFT" is False
    canonical_frame: bool = True  # points are seen, symmetries told, in PIFT's; D. 83, D. 95


@dataclass(frozen=True)
class AugmentationConfig:
    """Random views of a region's cloud while training (Sec. III-E)."""

    turn_deg: float = 25.0  # standard deviation, about the third axis: up, or the view
    tilt_deg: float = 3.0  # standard deviation, about each axis across it
    lost_table: float = 0.1  # of the regions that are seen as if no table were known
    scale: float = 0.15  # uniform scaling by at most this share
    jitter: float = 0.0005  # metres, standard deviation a coordinate
    principal_scale: float = 1.4  # of the Siamese copy: at most this factor, or its inverse


@dataclass(frozen=True)
class EndlessConfig:
    """Regions rendered while training; D. 59."""

    share: float = 0.0  # of each batch; the others are packed ones
    epoch_regions: int = 20_000  # that make an epoch where none are packed
    views: int = 4  # of a scene
    regions_per_scene: int = 20  # drawn from what its views show
    scenes_together: int = 16  # whose regions are shuffled among each other
    min_objects: int = 4
    max_objects: int = 9
    width: int = 640
    height: int = 480
    perfect_share: float = 0.1  # of the views without sensor noise
    occluders: float = 0.25  # of the views with an object held before the others
    mask_leaks: float = 0.15  # of the masks that take in a part of a neighbour
    mask_cuts: float = 0.1  # of the masks that are cut off
    pack: PackConfig = field(default_factory=PackConfig)


@dataclass(frozen=True)
class TrainConfig:
    """Training of the grasp network (Sec. III-G)."""

    network: NetworkConfig = field(default_factory=NetworkConfig)
    batch_size: int = 36
    learning_rate: float = 0.001
    decay: float = 0.9  # every `decay_epochs` epochs
    decay_epochs: float = 2.0
    epochs: int = 40
    weight_feature: float = 8.0  # w^f; the paper has 1, for another L^f: D. 96
    weight_affordance: float = 1.0  # w^a
    weight_symmetry: float = 5.0  # w^s
    weight_existence: float = 1.0  # w^c
    weight_parameters: float = 5.0  # w^r
    use_siamese: bool = True  # Table IV, "No Siamese Training" is False
    num_loss_points: int = 384  # of a region's 1,500; a random share of them costs less a step
    micro_batch_size: int = 0  # gradients are accumulated to `batch_size`; 0: by device, D. 58
    ema_decay: float = 0.998  # of the running mean of the weights that is kept; 0 for none
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)
    endless: EndlessConfig = field(default_factory=EndlessConfig)
    val_fraction: float = 0.1  # of the scenes
