"""Every number of the paper and of our choices: one frozen dataclass a stage.

`Sec.` cites the paper, `D.` a numbered choice of DECISIONS.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, TypeVar, get_type_hints

Config = TypeVar("Config")


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
class LabelGraspsConfig:
    """Grasp labels of the user's own meshes."""

    labels: LabelConfig = field(default_factory=lambda: LabelConfig(num_points=0))  # 0: by area
    point_area: float = 32e-6  # square metres a grasp point, GraspNet's density, D. 39
    min_points: int = 64
    max_points: int = 3500  # as GraspNet's largest label


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
    collision_labels: bool = True
    labels: LabelConfig = field(default_factory=LabelConfig)


@dataclass(frozen=True)
class AnnotateSymmetryConfig:
    """Symmetries of meshes (Sec. III-G); lengths are shares of the object's diameter."""

    mesh_scale: float = 1.0  # metres a unit of the mesh's file
    num_samples: int = 30000  # dense surface samples that distances are measured to
    num_verification_samples: int = 2000
    grid_resolution: int = 56
    distance_cap: float = 0.06  # a larger miss is no worse than this one
    plane_directions: int = 1000
    plane_offsets: tuple[float, ...] = (0.0, -0.04, 0.04, -0.08, 0.08)
    plane_candidates: int = 40
    plane_separation_deg: float = 7.0
    plane_offset_separation: float = 0.03
    axis_directions: int = 600
    axis_candidates: int = 3
    axis_separation_deg: float = 10.0
    max_mean: float = 0.006  # of the distance from the image to the surface
    max_axis_mean: float = 0.01  # a turn moves more of the surface than a mirror does
    max_p95: float = 0.025
    max_p99: float = 0.05
    max_error: float = 0.03  # mean distance over the largest displacement: thin things count too
    min_agreement: float = 0.65  # of normals, as a share of that of the surface with itself nearby
    max_unseen: float = 0.4  # share of samples whose image may land beyond an open rim
    max_planes: int = 3  # Sec. III-E: at most 3 reflections, 1 rotation, 1 sphere
    max_order: int = 8  # of a discrete rotation
    min_region_extent: float = 0.01  # metres, smaller regions cannot be grasped
    min_region_support: float = 0.8  # share of a region's surface its symmetry must explain
    min_body_share: float = 0.25  # of what curves about it, or mirror planes stay whole, D. 36
    min_part_share: float = 0.03  # of the area; smaller parts join the one they touch
    cut_objects: bool = True  # Table IV, "No symmetric region segmentation" is False, D. 67


@dataclass(frozen=True)
class RefineGraspsConfig:
    """Symmetric copies of grasp annotations (Sec. III-G, Fig. 6)."""

    use_symmetry: bool = True  # Table IV, "No dataset enhancement" is False
    max_friction: float = 1.0  # labelled grasps that hold at this friction are taken
    copies_per_turn: int = 36  # D. 3
    merge_distance: float = 0.001  # metres; closer contact pairs are one grasp, D. 2
    max_grasps: int = 200_000  # contact pairs of an object's label; of more, an even sample, D. 40
    max_copies: int = 200_000  # of these, under an object's symmetries and under each region's
    max_surface_gap: float = 0.003  # metres; a copy whose contact lies farther off is dropped
    validate_copies: bool = False  # close the fingers of each copy anew, measure its friction anew
    contact_radius: float = 0.004  # metres from a contact that its quality spreads to, D. 9
    num_surface_points: int = 4096
    chunk: int = 500_000  # candidates of a label that are read at a time


@dataclass(frozen=True)
class PackConfig:
    """Region clouds with labels, camera frame."""

    num_points: int = 2048  # stored; training draws 1,500 of them
    min_pixels: int = 300
    label_radius: float = 0.01  # metres from a point to the surface that labels it
    frame_stride: int = 1  # every n-th frame of a scene
    mask_noise: bool = True  # erode, dilate, leak: what a detector's masks are like
    mask_noise_share: float = 0.7  # of the masks; the others stay as they are
    mask_edge: float = 0.04  # largest erosion or dilation, of the root of the mask's area
    mask_blot: float = 0.15  # largest leak or gap, likewise


@dataclass(frozen=True)
class ExportCocoConfig:
    """Region masks as a COCO instance dataset (Sec. III-D)."""

    categories: str = "kind"  # or object, region
    min_pixels: int = 200  # smaller region masks are left out, as in training
    frame_stride: int = 1  # every n-th frame of a scene
    val_fraction: float = 0.1  # of the scenes
    link: bool = False  # link to the dataset's images, or copy them


@dataclass(frozen=True)
class DetectorConfig:
    """Mask R-CNN with an FPN (Sec. III-D)."""

    variant: str = "light"  # or resnet50
    input: str = "geometry"  # or color, both
    min_size: int = 288  # pixels, shorter side at the network's input
    max_size: int = 512  # and the longer one
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

    num_points: int = 1500
    feature_dim: int = 128
    set_points: tuple[int, int, int, int] = (384, 128, 32, 8)
    set_neighbors: tuple[int, int, int, int] = (16, 16, 16, 32)  # the last: all of its level
    set_strides: tuple[int, int, int, int] = (3, 1, 1, 1)  # every how many-th point is a neighbour
    use_pift: bool = True  # Table IV, "No PIFT" is False


@dataclass(frozen=True)
class AugmentationConfig:
    """Random views of a region's cloud while training (Sec. III-E)."""

    roll_deg: float = 25.0  # standard deviation, about the view axis
    tilt_deg: float = 10.0  # standard deviation, about each axis across it
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
    weight_feature: float = 1.0  # w^f
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


@dataclass(frozen=True)
class RegionConfig:
    """Regions found without a network: what stands on the support plane."""

    max_distance: float = 2.0  # metres from the camera
    max_range: float = 1.2  # metres beyond the nearest surfaces; behind it is background
    plane_tolerance: float = 0.010  # 1/metres of inverse depth: metres at one metre
    min_plane_share: float = 0.08  # of the near pixels; a smaller plane supports nothing
    beneath_weight: float = 2.0  # how much a near pixel beneath a plane speaks against it
    support_margin: float = 0.03  # metres that objects may stand out over the plane's border
    min_height: float = 0.006  # metres above the plane
    max_height: float = 0.5  # metres above the plane; higher is an arm or a wall
    min_pixels: int = 200
    max_extent: float = 0.45  # metres; larger is no object for this hand
    max_cut_extent: float = 0.2  # metres, of what the picture's border cuts off
    max_border: float = 3.0  # squared pixels on the border a pixel: more is a strip along it
    max_floating: float = 0.05  # metres between the table and the lowest visible part
    depth_step: float = 0.012  # of the depth, between neighbours: a longer step parts surfaces
    normal_radius: int = 4  # pixels that normals are smoothed over
    crease_fold: float = 0.6  # 2 sin(fold / 2) beyond which a concave crease parts regions
    crease_reach: float = 4.5  # how much longer than level a crease's chord may be


@dataclass(frozen=True)
class SelectionConfig:
    """Physics-feasible grasp selection (Sec. III-F)."""

    min_affordance: float = 0.5  # Sec. III-E
    weak_affordance: float = 0.1  # D. 27: below it no point of a region is worth a finger
    min_existence: float = 0.5  # D. 4
    min_trust: float = 0.1  # D. 66: of a symmetry that is fitted to what is seen
    min_completion: float = 0.5  # D. 32: trust in a symmetry that may complete the unseen side
    ground_symmetries: bool = True  # D. 31: fit predictions to what is seen; the paper does not
    max_pairs: int = 64  # contact pairs a region that are tried
    pair_spacing: float = 0.006  # metres between the first contacts of pairs that are tried
    max_contact_angle: float = 0.7  # radians between a contact's normal and the contact line
    min_width: float = 0.003  # metres; closer contacts are one
    num_approach_angles: int = 12  # M of Sec. III-F
    clearance_cap: float = 0.05  # metres, b of Eq. 8
    enclosed_height_cap: float = 0.03  # metres, h of Eq. 8
    weight_clearance: float = 1.0  # w^b
    weight_unseen: float = 0.9  # D. 68: of the finger tips' room that is not seen
    weight_height: float = 5.0  # w^h
    min_enclosed: float = 0.004  # metres of the object that must be between the fingers
    behind_tolerance: float = 0.005  # metres a counterpart may float before the surface, D. 6
    depth_noise: float = 0.003  # metres at one metre, growing with z^2, D. 6
    min_table_distance: float = 0.004  # metres between finger tips and table
    max_approach_angle: float = 1.75  # radians between approach and the table's inward normal
    max_view_angle: float = 1.05  # radians between approach and view ray where no table is seen
    max_hidden_angle: float = 1.92  # the same over a table: no coming from behind what is seen
    scene_resolution: float = 0.003  # metres that the scene is thinned to for collisions
    body_margin: float = 0.001  # metres that the gripper's bodies are blown up by
    max_points_inside: int = 2  # measured points, as noise, that a body may hold
    steadiness: float = 0.85  # of the best candidate's, that a candidate needs to be ranked

    @property
    def least_trust(self) -> float:
        """Existence above which grasps rest on a symmetry: fitted ones may be tried early."""
        return self.min_trust if self.ground_symmetries else self.min_existence


@dataclass(frozen=True)
class InferConfig:
    """Frames in, grasps out."""

    regions: str = "auto"  # or detector, geometric
    method: str = "network"  # or planar, random: baselines
    gripper: str = "rg2"
    geometric_confidence: float = 0.4  # of regions that the detector did not name
    min_region_pixels: int = 200
    min_foreground: float = 0.5  # share of a detection that must stand above the table
    min_uncovered: float = 0.5  # share of a geometric region that detections must leave
    min_piece_inside: float = 0.8  # share of a geometric piece within a region without grasps
    max_grasps_per_region: int = 20
    region: RegionConfig = field(default_factory=RegionConfig)
    selection: SelectionConfig = field(default_factory=SelectionConfig)


@dataclass(frozen=True)
class InspectConfig:
    """What would be read of a folder of frames."""

    max_frames: int = 100  # read, evenly spread over what is found


@dataclass(frozen=True)
class ConvertFramesConfig:
    """Frames of any layout as flat pairs."""

    trust_pickle: bool = False  # also take the arrays out of pickles; D. 53


@dataclass(frozen=True)
class ExportConfig:
    """Grasps in the formats of other tools."""

    to: str = "graspnet"
    gripper: str = ""  # the one that `infer` used


@dataclass(frozen=True)
class ScoreGraspsConfig:
    """Anybody's grasps on anybody's mesh, in graspnetAPI's rows."""

    compatible: bool = False  # graspnetAPI's verdicts, its faults included
    mesh_scale: float = 1.0  # to metres
    max_width: float = 0.1  # metres, the peer's; wider openings are cut to it
    friction_grid: tuple[float, ...] = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)  # the peer's


@dataclass(frozen=True)
class EvaluateConfig:
    """Metrics (Sec. IV)."""

    min_visible_pixels: int = 300  # objects less visible do not count
    symmetry_thresholds: tuple[float, ...] = (0.25, 0.134, 0.067)  # dense error, D. 11
    sphere_threshold: float = 0.05  # metres, Sec. IV-E
    min_region_share: float = 0.3  # of a region's pixels on the object whose region it is
    min_region_iou: float = 0.25  # with the true region whose symmetries it is asked for
    gripper: str = ""  # the one that `infer` used


@dataclass(frozen=True)
class EvaluateDumpConfig:
    """GraspNet-1Billion's protocol on dumps of any detector; the rest of it has no choices."""

    exact: bool = False  # exact contacts and collision instead of graspnetAPI's
    max_width: float = 0.1  # metres, the peer's; wider openings are cut to it


@dataclass(frozen=True)
class CompareConfig:
    """Runs side by side: a paired bootstrap over frames or scenes."""

    row: str = "ours"  # of the reports
    unit: str = "frame"  # or scene: what is drawn
    resamples: int = 2000
    level: float = 0.95


@dataclass(frozen=True)
class SimulateConfig:
    """Success in physics (Sec. IV-A, Table III); D. 48, D. 49."""

    frictions: tuple[float, ...] = (0.3, 0.5, 0.8)  # between fingers and objects
    approach: float = 0.10  # metres, along the approach axis
    lift: float = 0.15  # metres
    tug: float = 5.0  # m / s^2, of each of five tugs, on top of gravity
    max_slip: float = 0.05  # metres in the hand, from closing to the end
    max_turn: float = 15.0  # degrees, likewise
    grip_force: float = 8.0  # of a finger, in weights of the object: 20 N on a quarter of a kg
    max_force: float = 40.0  # newtons of a finger, an RG2's largest
    arm_force: float = 60.0  # newtons that the arm pushes with at most
    stop_force: float = 30.0  # newtons on the way in at which a careful arm stops
    convex_enough: float = 0.98  # share of its hull's volume that a model fills to be one piece
    concavity: float = 0.03  # of pieces, coacd's: a bowl's wall comes out some millimetres thick
    max_pieces: int = 32  # of a model
    min_visible_pixels: int = 300  # objects less visible do not count
    min_region_share: float = 0.3  # of a region's pixels on the object whose region it is
    gripper: str = ""  # the one that `infer` used


def from_settings(kind: type[Config], settings: Mapping[str, Any]) -> Config:
    """Return the config that a stamp holds as JSON, without the names that `kind` lacks."""
    types, chosen = get_type_hints(kind), {}
    for each in fields(kind):  # type: ignore[arg-type]  # a dataclass
        if each.name not in settings:
            continue
        value, inner = settings[each.name], types[each.name]
        if is_dataclass(inner) and isinstance(inner, type):
            value = from_settings(inner, value)
        chosen[each.name] = tuple(value) if isinstance(value, list) else value
    return kind(**chosen)
