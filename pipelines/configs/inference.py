"""Settings of the stages that turn frames into grasps and show them."""

from dataclasses import dataclass, field
from math import inf
from typing import Literal

from pipelines.configs.declaration import BY_EYE, choice, count, fraction, setting
from pipelines.configs.planning import (
    ROBOT,
    LimitsConfig,
    ReferenceFrame,
    SelectionConfig,
    SensorConfig,
)
from pipelines.configs.regions import LEAST_PIXELS, RegionConfig

RegionSource = Literal["auto", "detector", "geometric"]
Method = Literal[
    "network",
    "planar",
    "random",
    "symmetry-icp",
    "gg-cnn",
    "multi-grasp",
    "pointnetgpd",
    "graspnet",
    "symmetrynet",
]
# Compared methods that find grasps in a whole frame, without regions.
FRAME_PEERS = ("gg-cnn", "multi-grasp", "pointnetgpd", "graspnet")
REGION_PEERS = ("symmetrynet",)  # compared methods that find symmetries of regions
TRAINED_METHODS = (*FRAME_PEERS, *REGION_PEERS)
ExportFormat = Literal["graspnet", "contact-graspnet", "isaac", "json", "csv", "ros-json"]

TCP = (
    "Tool centre point of the poses: tips, contacts, or its distance from the mounting "
    "face along the approach in metres; empty for the format's own origin."
)
GRIPPER_USED = (
    "Gripper preset or TOML file; empty for the gripper that the grasps were planned for."
)


@dataclass(frozen=True)
class InferConfig:
    """Detection of grasps in frames."""

    regions: RegionSource = choice(
        "auto",
        "Source of regions: auto, the detector, completed from depth and colour; detector, the "
        "detector alone; geometric, depth alone.",
        "D. 19",
    )
    method: Method = choice(
        "network",
        "Planner: the network; planar, random or symmetry-icp, which fits symmetries to the points "
        f"alone; or a compared method with --weights: {', '.join(TRAINED_METHODS)}.",
        "Sec. IV-A, IV-E",
    )
    selects_for_compared_methods: bool = choice(
        False,
        "Keep only feasible grasps of a compared method, by our selection (Sec. III-F).",
        "D. 133",
    )
    mirrored: bool = choice(
        False, "Run the network on the mirror image of each region too.", "D. 101"
    )
    gripper: str = choice("rg2", "Gripper: rg2, robotiq_2f85, franka, or a TOML file.", "D. 54")
    geometric_confidence: float = fraction(
        0.4, "Confidence of regions that no detector has found or rated.", BY_EYE
    )
    min_rating: float = fraction(
        0.0001,
        "Least confidence of the detector in the box of a region that it did not find.",
        "D. 147",
    )
    min_region_pixels: int = setting(200, "px", LEAST_PIXELS, "D. 149", low=1)
    min_foreground: float = fraction(0.5, "Least share of a detection above the table.", BY_EYE)
    clip_detections: bool = choice(
        True, "Remove from detections the pixels that depth shows on the table.", "D. 19"
    )
    min_uncovered: float = fraction(
        0.5, "Least share of a geometric region outside of detections.", BY_EYE
    )
    min_piece_share: float = fraction(
        0.1, "Least share of each piece when a detection is split.", "D. 97"
    )
    min_piece_inside: float = fraction(
        0.8, "Least share of a geometric piece inside a region without grasps.", "D. 97"
    )
    max_grasps_per_region: int = count(20, "Most grasps of a region, no two alike.", BY_EYE)
    min_score: float = fraction(0.0, "Score below which grasps are left out.", ROBOT)
    weak_below: float = fraction(
        0.3, "Score below which kept grasps are marked as not worth trying.", "D. 124"
    )
    limits: LimitsConfig = field(default_factory=LimitsConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)
    region: RegionConfig = field(default_factory=RegionConfig)
    selection: SelectionConfig = field(default_factory=SelectionConfig)


@dataclass(frozen=True)
class WatchConfig:
    """Waiting times of `infer --watch`."""

    poll: float = setting(0.1, "s", "Time between checks of the folder.", "D. 75", low=0.001)
    relist: float = setting(
        2.0, "s", "Time after which folders without visible changes are listed again.", "D. 75"
    )
    settle: float = setting(
        0.3, "s", "Time without change after which a frame's files are complete.", "D. 75"
    )
    patience: float = setting(
        5.0, "s", "Time without change after which an unreadable frame has failed.", "D. 75"
    )
    quiet: float = setting(
        2.0, "s", "Time without a frame after which the output is assembled.", "D. 75"
    )
    timeout: float = setting(
        inf, "s", "Time without a new frame after which watching ends; inf for never.", BY_EYE
    )


@dataclass(frozen=True)
class InspectConfig:
    """Summary of a folder of frames."""

    max_frames: int = count(100, "Most frames to read, evenly spread over the folder.", BY_EYE)


@dataclass(frozen=True)
class WorkspaceConfig:
    """A workspace around the objects on a table."""

    box: tuple[float, ...] = setting(
        (),
        "m",
        "Corners x0,y0,z0,x1,y1,z1 of a box to draw; empty for one around all regions.",
        ROBOT,
        low=-inf,
        fewest=0,
    )
    box_frame: ReferenceFrame = choice("table", "Frame of a given box: camera or table.", ROBOT)
    margin: float = setting(0.05, "m", "Space around the regions.", BY_EYE, high=10.0)
    max_frames: int = count(20, "Most frames to draw, from the first.", BY_EYE)


@dataclass(frozen=True)
class ConvertFramesConfig:
    """Frames of any layout as flat pairs."""

    trust_pickle: bool = choice(False, "Read arrays from pickles too, and nothing else.", "D. 53")


@dataclass(frozen=True)
class DoctorConfig:
    """Requirements on a machine, and tolerances between its grasps and the expected grasps."""

    min_free_memory: float = setting(2e9, "bytes", "Memory below which to warn.", "D. 64")
    min_free_disk: float = setting(1e9, "bytes", "Disk space below which to warn.", BY_EYE)
    max_product_error: float = fraction(
        1e-4, "Largest error of a GPU's products, relative to the largest entry.", BY_EYE
    )
    max_shift: float = setting(0.001, "m", "Largest shift of a grasp or change of width.", "D. 76")
    max_turn: float = setting(0.035, "rad", "Largest turn of a grasp.", "D. 76")
    min_agreeing: float = fraction(
        0.85, "Least share of the expected grasps that are found.", "D. 76"
    )


@dataclass(frozen=True)
class ExportConfig:
    """Grasps in the formats of other tools."""

    to: ExportFormat = choice(
        "graspnet",
        "Format: graspnetAPI's dump, Contact-GraspNet's predictions, isaac_grasp YAML, json, csv, "
        "or a ROS PoseArray as JSON.",
        "D. 70",
    )
    gripper: str = choice(
        "",
        "Gripper preset or TOML file: gives the base of the poses and must open wide enough; "
        "empty for the gripper that the grasps were planned for.",
        "D. 71",
    )
    min_score: float = fraction(0.0, "Score below which grasps are left out.", ROBOT)
    tcp: str = choice("", TCP, ROBOT)
    frame_id: str = choice(
        "",
        "Frame name of the poses in ros-json; empty for camera_color_optical_frame, or with "
        "--camera-to-base for the base frame that the file names, else base_link.",
        ROBOT,
    )


@dataclass(frozen=True)
class GripperConfig:
    """Dimensions that a gripper's URDF does not contain."""

    base_link: str = choice(
        "",
        "Link whose origin is the mounting face; empty for the link the fingers slide on.",
        BY_EYE,
    )
    tip_reach: float = setting(
        0.005, "m", "Distance of the tips past the contacts.", BY_EYE, high=1.0
    )
    clearance: float = setting(
        0.006, "m", "Finger clearance: from a contact to its open finger.", "D. 54", high=1.0
    )


@dataclass(frozen=True)
class ServeConfig:
    """Grasps over HTTP."""

    host: str = choice("127.0.0.1", "Address to listen on; default: this machine only.", BY_EYE)
    port: int = count(8765, "Port to listen on.", BY_EYE, low=0, high=65535)
    parallel: int = count(4, "Frames processed at a time, one core each.", BY_EYE, high=256)
    max_waiting: int = count(
        32, "Posts being read, waiting or processed; further posts are refused.", BY_EYE
    )
    max_wait: float = setting(
        30.0,
        "s",
        "Expected time until the answer beyond which a post that would wait is refused.",
        BY_EYE,
        high=86_400,
    )
    max_bytes: int = setting(64_000_000, "bytes", "Largest post.", BY_EYE, low=1000)
    max_pixels: int = setting(12_000_000, "px", "Largest image of a post.", BY_EYE, low=1)
    grace: int = setting(
        8,
        "s",
        "Time for begun frames to finish when the server shuts down.",
        BY_EYE,
        high=86_400,
    )
    min_score: float = fraction(0.0, "Score below which grasps are left out.", ROBOT)
    tcp: str = choice("", TCP, ROBOT)


@dataclass(frozen=True)
class ViewConfig:
    """Frames as interactive 3D pages for a browser."""

    gripper: str = choice("", GRIPPER_USED, "D. 71")
    max_pixels: int = setting(
        410_000,
        "px",
        "Most points of a page, some 10 bytes each; larger frames are thinned.",
        "D. 72",
        low=1000,
        high=700_000,
    )
    max_grasps: int = count(
        4000, "Most grasps of a page, the best of each region first; 300 bytes each.", BY_EYE
    )
    picture_width: int = setting(320, "px", "Width of the index's pictures.", BY_EYE, low=16)
