"""Settings of the stages that make datasets: objects, labels, symmetries, packed regions."""

from dataclasses import dataclass, field
from typing import Literal

from pipelines.configs.declaration import BY_EYE, choice, count, fraction, setting

Split = Literal["train", "seen", "similar", "novel"]
Sensor = Literal["perfect", "kinect", "realsense", "mixed"]
Surrounding = Literal["plain", "bin", "tray", "wall", "edge", "base"]
FamilySet = Literal["first", "wide", "sealed"]
Colors = Literal["plain", "varied"]
RegionCategory = Literal["kind", "object", "region"]

GRASPNET = "GraspNet-1Billion"
SURROUNDINGS = (
    "Surroundings, one drawn for each scene: plain, a large table; bin or tray, with the objects "
    "in it; wall, behind the objects; edge, the table's edge; base, a robot's base next to the "
    "objects. Repeat a name for a larger share."
)
HANDS_SHARE = "Share of the views with a robot's hand that enters from the image border."
SCENE_COLORS = (
    "Textures, light and camera: plain, as indoors; varied, any material and print on any surface, "
    "several lamps of any colour, cameras that tint, blur and compress."
)
DEPTH_FAULTS = (
    "Share of the views with depth faults measured on real frames: holes on dark, shiny and "
    "absorbing patches, points afloat at edges, wavy surfaces."
)
FAMILY_SETS = (
    "Families of the objects: first, 24 for training and 21 novel; wide, 21 more for training; "
    "sealed, as wide with 12 other novel families."
)
FRAME_STRIDE = "Take every n-th frame of a scene."
MAX_LABEL_POINTS = 100_000  # of an object's grasp label; GraspNet's have up to 3,500


@dataclass(frozen=True)
class LabelConfig:
    """Grasp labels by sample-and-validate, on GraspNet's grid."""

    num_points: int = count(
        64,
        "Grasp points of an object; 0 for none (label-grasps: by area).",
        BY_EYE,
        low=0,
        high=MAX_LABEL_POINTS,
    )
    num_views: int = count(300, "Approach directions of a point.", GRASPNET)
    num_angles: int = count(12, "Approach angles of each direction.", GRASPNET)
    depths: tuple[float, ...] = setting(
        (0.01, 0.02, 0.03, 0.04), "m", "Depths of the finger tips behind a point.", GRASPNET
    )
    friction_grid: tuple[float, ...] = setting(
        (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0),
        "factor",
        "Friction coefficients tried.",
        GRASPNET,
    )
    max_width: float = setting(0.12, "m", "Widest opening of a labelled grasp.", BY_EYE)
    width_margin: float = setting(
        0.01, "m", "Opening beyond the distance of the contacts.", "D. 38"
    )


@dataclass(frozen=True)
class LabelGraspsConfig:
    """Grasp labels of the user's own meshes."""

    labels: LabelConfig = field(default_factory=lambda: LabelConfig(num_points=0))  # 0: by area
    point_area: float = setting(32e-6, "m2", "Surface area per grasp point.", "D. 39", low=1e-9)
    min_points: int = count(64, "Fewest grasp points of an object.", "D. 39", high=MAX_LABEL_POINTS)
    max_points: int = count(3500, "Most grasp points of an object.", "D. 39", high=MAX_LABEL_POINTS)


@dataclass(frozen=True)
class SceneryConfig:
    """Surroundings and appearance of synthetic scenes."""

    surroundings: tuple[Surrounding, ...] = choice(("plain",), SURROUNDINGS, BY_EYE)
    robot_hands: float = fraction(0.0, HANDS_SHARE, BY_EYE)
    colors: Colors = choice("plain", SCENE_COLORS, BY_EYE)
    depth_faults: float = fraction(0.0, DEPTH_FAULTS, "docs/experiments/data-sets.md")


@dataclass(frozen=True)
class SynthesizeConfig:
    """Procedural scenes in GraspNet-1Billion's layout."""

    splits: tuple[Split, ...] = choice(
        ("train", "seen", "similar", "novel"), "Splits to make, separated by commas.", GRASPNET
    )
    scenes_per_split: int = count(10, "Scenes of each split.", BY_EYE)
    views: int = count(16, "Viewpoints of a scene; GraspNet has 256.", BY_EYE)
    objects_per_pool: int = count(40, "Objects of each pool: seen, similar, novel.", BY_EYE)
    min_objects: int = count(4, "Fewest objects of a scene.", BY_EYE)
    max_objects: int = count(9, "Most objects of a scene.", BY_EYE)
    sensor: Sensor = choice("realsense", "Depth sensor; mixed draws one for each scene.", BY_EYE)
    width: int = setting(1280, "px", "Width of the images.", GRASPNET, low=1)
    height: int = setting(720, "px", "Height of the images.", GRASPNET, low=1)
    collision_labels: bool = choice(
        True, "Check the labelled grasps for collisions in each scene.", GRASPNET
    )
    labels: LabelConfig = field(default_factory=LabelConfig)
    families: FamilySet = choice("first", FAMILY_SETS, "docs/experiments/data-sets.md")
    scenery: SceneryConfig = field(default_factory=SceneryConfig)


@dataclass(frozen=True)
class AnnotateSymmetryConfig:
    """Symmetries of meshes (Sec. III-G)."""

    num_samples: int = count(
        30000, "Dense surface samples that distances are measured to.", BY_EYE, low=100
    )
    num_verification_samples: int = count(
        2000, "Surface samples that a symmetry is verified on.", "D. 55", low=100
    )
    grid_resolution: int = count(56, "Cells of the distance grid along a side.", BY_EYE, low=4)
    distance_cap: float = setting(0.06, "diameters", "Cap of the distances to the surface.", BY_EYE)
    plane_directions: int = count(1000, "Normals of planes that are searched.", BY_EYE)
    plane_offsets: tuple[float, ...] = setting(
        (0.0, -0.04, 0.04, -0.08, 0.08),
        "diameters",
        "Plane offsets from the centroid.",
        BY_EYE,
        low=-1.0,
    )
    plane_candidates: int = count(40, "Planes that are refined.", BY_EYE)
    plane_separation_deg: float = setting(
        7.0, "deg", "Angle below which two candidates are one plane.", BY_EYE
    )
    plane_offset_separation: float = setting(
        0.03, "diameters", "Distance below which parallel candidates are one plane.", BY_EYE
    )
    axis_directions: int = count(600, "Directions of axes that are searched.", BY_EYE)
    axis_candidates: int = count(3, "Axes that are refined.", BY_EYE)
    axis_separation_deg: float = setting(
        10.0, "deg", "Angle below which two candidates are one axis.", BY_EYE
    )
    max_mean: float = setting(
        0.006, "diameters", "Largest mean distance from a mirror image to the surface.", BY_EYE
    )
    max_axis_mean: float = setting(
        0.01, "diameters", "Largest mean distance for an axis, which moves more surface.", BY_EYE
    )
    max_p95: float = setting(0.025, "diameters", "Largest 95th percentile of distances.", BY_EYE)
    max_p99: float = setting(
        0.044,
        "diameters",
        "Largest 99th percentile of these distances; 1.2 times as large for an axis.",
        "D. 138",
    )
    max_error: float = fraction(
        0.03,
        "Largest mean distance, relative to the largest displacement: limits thin objects.",
        BY_EYE,
    )
    min_agreement: float = fraction(
        0.65, "Least agreement of normals, relative to the agreement of nearby normals.", "D. 34"
    )
    max_unseen: float = fraction(
        0.4, "Largest share of samples with images beyond an open rim.", "D. 35"
    )
    max_planes: int = count(3, "Most planes of a region.", "Sec. III-E", low=0, high=3)
    max_order: int = count(8, "Highest order of a discrete rotation.", BY_EYE, low=2)
    min_region_extent: float = setting(0.01, "m", "Least size for fingers to close on.", BY_EYE)
    min_region_support: float = fraction(
        0.8, "Least share of a region's surface that its symmetry explains.", "D. 36"
    )
    min_body_share: float = fraction(
        0.25,
        "Share of bodies of revolution in the curved surface from which an object is cut.",
        "D. 36",
    )
    min_part_share: float = fraction(
        0.03, "Area share below which a part is merged with the part that it touches.", "D. 36"
    )
    cut_objects: bool = choice(
        True,
        "Cut objects into symmetric regions; without, objects symmetric as a whole are one region "
        "and others have none (Table IV).",
        "D. 67",
    )


@dataclass(frozen=True)
class RefineGraspsConfig:
    """Symmetric copies of grasp annotations (Sec. III-G, Fig. 6)."""

    use_symmetry: bool = choice(
        True, "Copy grasps across symmetries; without, labels stay as they are.", "Table IV"
    )
    max_friction: float = setting(1.0, "factor", "Largest friction of a kept grasp.", "D. 15")
    copies_per_turn: int = count(
        36, "Copies about a continuous axis, evenly turned.", "D. 3", high=72
    )
    merge_distance: float = setting(
        0.001, "m", "Distance of contacts below which grasps are duplicates.", "D. 2", low=1e-5
    )
    max_grasps: int = count(200_000, "Most contact pairs of a label, sampled evenly.", "D. 40")
    max_copies: int = count(
        200_000, "Most copies by an object's symmetries, and by each region's.", "D. 40"
    )
    max_surface_gap: float = setting(
        0.003, "m", "Distance from the surface beyond which a copy is dropped.", "D. 3"
    )
    validate_copies: bool = choice(
        False, "Close the fingers of each copy on the mesh again and measure its friction.", "D. 3"
    )
    contact_radius: float = setting(
        0.004, "m", "Distance from a contact up to which points take its quality.", "D. 9", low=1e-5
    )
    num_surface_points: int = count(4096, "Points of a mesh that have an affordance.", BY_EYE)
    chunk: int = count(500_000, "Candidates of a label read at a time.", BY_EYE)


@dataclass(frozen=True)
class PackConfig:
    """Labelled clouds of regions, camera frame."""

    num_points: int = count(2048, "Points stored per region; training draws 1,500.", BY_EYE)
    min_pixels: int = setting(300, "px", "Pixels below which a region is left out.", BY_EYE, low=1)
    label_radius: float = setting(
        0.01, "m", "Largest distance from a point to the surface that labels it.", BY_EYE
    )
    frame_stride: int = count(1, FRAME_STRIDE, BY_EYE)
    mask_noise: bool = choice(
        True, "Disturb the masks as a detector would; without, masks are exact.", BY_EYE
    )
    mask_noise_share: float = fraction(0.7, "Share of the masks disturbed.", BY_EYE)
    mask_edge: float = fraction(
        0.04, "Largest erosion or dilation, relative to the root of the mask's area.", BY_EYE
    )
    mask_blot: float = fraction(0.15, "Largest leak or gap, as `mask_edge`.", BY_EYE)


@dataclass(frozen=True)
class ExportCocoConfig:
    """Region masks as a COCO instance dataset (Sec. III-D)."""

    categories: RegionCategory = choice(
        "kind", "Categories: kind of symmetry, object, or a single one, region.", BY_EYE
    )
    min_pixels: int = setting(200, "px", "Pixels below which a region is left out.", BY_EYE, low=1)
    frame_stride: int = count(1, FRAME_STRIDE, BY_EYE)
    val_fraction: float = fraction(0.1, "Share of the scenes to validate on.", BY_EYE)
    link: bool = choice(False, "Link to the dataset's images instead of copying them.", BY_EYE)
