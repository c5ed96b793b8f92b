"""Every number of the paper and of our choices: one frozen dataclass a stage.

`Sec.` cites the paper, `D.` a numbered choice of DECISIONS.md.
"""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class LabelConfig:
    """Grasp labels by sample-and-validate, on GraspNet's grid."""

    num_points: int = 64  # grasp points an object
    num_views: int = 300
    num_angles: int = 12
    depths: tuple[float, ...] = (0.01, 0.02, 0.03, 0.04)
    friction_grid: tuple[float, ...] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    max_width: float = 0.12  # metres
    width_margin: float = 0.01  # metres, opening beyond the distance of the contacts


@dataclass(frozen=True)
class SynthesizeConfig:
    """Procedural scenes in GraspNet-1Billion's layout."""

    splits: tuple[str, ...] = ("train", "seen", "similar", "novel")
    scenes_per_split: int = 10
    views: int = 16
    objects_per_pool: int = 40
    min_objects: int = 4
    max_objects: int = 9
    sensor: str = "realsense"
    width: int = 1280  # as GraspNet
    height: int = 720
    labels: LabelConfig = field(default_factory=LabelConfig)


@dataclass(frozen=True)
class AnnotateSymmetryConfig:
    """Symmetries of meshes (Sec. III-G); lengths are shares of the bounding box's diagonal."""

    num_samples: int = 4000
    num_candidate_normals: int = 800
    max_planes: int = 3  # Sec. III-E: at most 3 reflections, 1 rotation, 1 sphere
    min_region_extent: float = 0.01  # metres, smaller regions cannot be grasped
    min_region_support: float = 0.6  # share of a region's surface its symmetry must explain


@dataclass(frozen=True)
class RefineGraspsConfig:
    """Symmetric copies of grasp annotations (Sec. III-G, Fig. 6)."""

    copies_per_turn: int = 36  # D. 3
    sphere_axes: int = 12  # random axes through a sphere's centre, D. 3
    use_symmetry: bool = True  # Table IV, "No dataset enhancement" is False
    contact_radius: float = 0.004  # metres from a contact that its quality spreads to, D. 9
    num_surface_points: int = 4096
    merge_distance: float = 0.001  # metres; closer copies are one grasp, D. 2


@dataclass(frozen=True)
class PackConfig:
    """Region clouds with labels, camera frame."""

    num_points: int = 2048  # stored; training draws 1,500 of them
    min_pixels: int = 300
    label_radius: float = 0.01  # metres from a point to the surface that labels it
    mask_noise: bool = True  # erode, dilate, leak: what a detector's masks are like


@dataclass(frozen=True)
class DetectorConfig:
    """Mask R-CNN with an FPN (Sec. III-D)."""

    variant: str = "light"  # or resnet50
    input: str = "geometry"  # or color, both
    min_size: int = 288  # pixels, shorter side at the network's input
    max_size: int = 384
    max_detections: int = 40
    min_confidence: float = 0.5
    mask_threshold: float = 0.5
    nms_threshold: float = 0.5


@dataclass(frozen=True)
class FinetuneDetectorConfig:
    """Training of the region detector."""

    detector: DetectorConfig = field(default_factory=DetectorConfig)
    epochs: int = 12
    batch_size: int = 4
    learning_rate: float = 0.001
    min_pixels: int = 200  # smaller region masks are not trained on
    val_fraction: float = 0.1  # of the scenes


@dataclass(frozen=True)
class NetworkConfig:
    """PointNet++ with PIFT (Sec. III-E, III-G)."""

    num_points: int = 1500
    feature_dim: int = 128
    set_points: tuple[int, int, int, int] = (384, 96, 24, 8)
    set_radii: tuple[float, float, float, float] = (0.015, 0.03, 0.06, 0.12)  # metres
    set_neighbors: tuple[int, int, int, int] = (24, 24, 16, 8)
    use_pift: bool = True  # Table IV, "No PIFT" is False


@dataclass(frozen=True)
class TrainConfig:
    """Training of the grasp network (Sec. III-G)."""

    network: NetworkConfig = field(default_factory=NetworkConfig)
    batch_size: int = 36
    learning_rate: float = 0.001
    decay: float = 0.9  # every `decay_epochs` epochs
    decay_epochs: int = 2
    epochs: int = 40
    weight_feature: float = 1.0  # w^f
    weight_affordance: float = 1.0  # w^a
    weight_symmetry: float = 5.0  # w^s
    weight_existence: float = 1.0  # w^c
    weight_parameters: float = 5.0  # w^r
    use_siamese: bool = True  # Table IV, "No Siamese Training" is False
    val_fraction: float = 0.1  # of the scenes


@dataclass(frozen=True)
class RegionConfig:
    """Regions found without a network: what stands on the support plane."""

    max_distance: float = 2.0  # metres from the camera
    plane_tolerance: float = 0.006  # metres, at one metre; grows with the square of the distance
    min_height: float = 0.008  # metres above the plane
    min_pixels: int = 200
    max_extent: float = 0.45  # metres; larger is no object for this hand


@dataclass(frozen=True)
class SelectionConfig:
    """Physics-feasible grasp selection (Sec. III-F)."""

    min_affordance: float = 0.5  # Sec. III-E
    min_existence: float = 0.5  # D. 4
    max_pairs: int = 200  # contact pairs a region that are tried
    num_approach_angles: int = 12  # M of Sec. III-F
    clearance_cap: float = 0.05  # metres, b of Eq. 8
    enclosed_height_cap: float = 0.03  # metres, h of Eq. 8
    weight_clearance: float = 1.0  # w^b
    weight_height: float = 5.0  # w^h
    behind_tolerance: float = 0.005  # metres a counterpart may float before the surface, D. 6
    min_table_distance: float = 0.004  # metres between finger tips and table
    max_approach_angle: float = 1.75  # radians between approach and the table's inward normal


@dataclass(frozen=True)
class InferConfig:
    """Frames in, grasps out."""

    regions: str = "auto"  # or detector, geometric, masks
    method: str = "network"  # or planar, random: baselines
    gripper: str = "rg2"
    min_region_pixels: int = 200
    max_grasps_per_region: int = 20
    region: RegionConfig = field(default_factory=RegionConfig)
    selection: SelectionConfig = field(default_factory=SelectionConfig)


@dataclass(frozen=True)
class EvaluateConfig:
    """Metrics (Sec. IV)."""

    min_visible_pixels: int = 300  # objects less visible do not count
    symmetry_thresholds: tuple[float, ...] = (0.25, 0.134, 0.067)  # dense error, D. 11
    sphere_threshold: float = 0.05  # metres, Sec. IV-E
    mask_iou: float = 0.5
    gripper: str = "rg2"
