"""The dataset side: objects, labels, symmetries, packed regions."""

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
