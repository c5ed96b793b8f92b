"""From frames to grasps."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class RegionConfig:
    """Regions found without a network: what stands on the support plane."""

    max_distance: float = 2.0  # metres from the camera
    max_range: float = 1.2  # metres beyond the nearest surfaces; behind it is background
    plane_tolerance: float = 0.010  # 1/metres of inverse depth: metres at one metre
    min_plane_share: float = 0.08  # of the near pixels; a smaller plane supports nothing
    min_support_area: float = 0.008  # square metres seen of it; less is a finger before the lens
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
    min_confidence: float = 0.2  # D. 66: of a symmetry that is fitted to what is seen
    min_doubtful_confidence: float = 0.03  # D. 88: where all else is poor
    min_completion_confidence: float = 0.5  # D. 32: to complete the unseen side
    min_neighbour_confidence: float = 0.3  # D. 85: of neighbours, to keep off
    ground_symmetries: bool = True  # D. 31: fit predictions to what is seen; the paper does not
    max_pairs: int = 256  # contact pairs a region that are tried
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
    approach_distance: float = 0.10  # metres of the way in, D. 77
    nms_distance: float = 0.03  # metres between alike grasps of a region, as GraspNet's
    nms_angle: float = 0.5235987755982988  # radians, 30 degrees, likewise, D. 78
    body_margin: float = 0.001  # metres that the gripper's bodies are blown up by
    max_points_inside: int = 2  # measured points, as noise, that a body may hold
    opening_margins: tuple[float, ...] = (
        0.008,
        0.006,
        0.004,
        0.002,
    )  # metres, the most first, D. 92
    opening_margin_share: float = 0.25  # of the width, at most, D. 102
    rank_by: str = "critic"  # D. 82: the quality to expect; or eq8, as the paper
    min_stability: float = 0.85  # of the best candidate's, that a candidate needs for Eq. 8
    max_ranked: int = 96  # hands of a region and kind that are ranked, the steadiest
    critic_min_stability: float = 0.6  # the same, to be judged
    planar_below: float = 0.6  # best expectation of symmetric grasps that others may beat

    @property
    def uses_grasp_critic(self) -> bool:
        """Whether grasps are ranked by the quality to expect, not by Eq. 8."""
        return self.rank_by == "critic"

    @property
    def least_confidence(self) -> float:
        """Existence above which grasps rest on a symmetry: fitted ones may be tried early."""
        return self.min_confidence if self.ground_symmetries else self.min_existence


@dataclass(frozen=True)
class LimitsConfig:
    """Where the robot may grasp, and from where; by default anywhere."""

    box: tuple[float, ...] = ()  # x0, y0, z0, x1, y1, z1 metres
    box_frame: str = "camera"  # or table: z up from it, its origin nearest to the camera
    approach_cone: float = 180.0  # degrees about the direction
    approach_direction: tuple[float, ...] = (0.0, 0.0, -1.0)
    approach_frame: str = "table"  # or camera


@dataclass(frozen=True)
class InferConfig:
    """Frames in, grasps out."""

    regions: str = "auto"  # or detector, geometric
    method: str = "network"  # or planar, random: baselines
    mirrored: bool = False  # whether the network sees regions' mirror images too; D. 101
    gripper: str = "rg2"
    geometric_confidence: float = 0.4  # of regions that the detector did not name
    min_region_pixels: int = 200
    min_foreground: float = 0.5  # share of a detection that must stand above the table
    min_uncovered: float = 0.5  # share of a geometric region that detections must leave
    min_piece_share: float = 0.1  # of a detection, that each of its pieces has at least; D. 97
    min_piece_inside: float = 0.8  # share of a geometric piece within a region without grasps
    max_grasps_per_region: int = 20
    limits: LimitsConfig = field(default_factory=LimitsConfig)
    region: RegionConfig = field(default_factory=RegionConfig)
    selection: SelectionConfig = field(default_factory=SelectionConfig)


@dataclass(frozen=True)
class WatchConfig:
    """How long `infer --watch` waits for what, in seconds (D. 75)."""

    poll: float = 0.1  # between looks at the folder
    relist: float = 2.0  # until folders are listed that do not look changed
    settle: float = 0.3  # without change, after which a frame's files are whole
    patience: float = 5.0  # without change, after which a frame that cannot be read has failed
    quiet: float = 2.0  # without a frame, after which the output is put together
    timeout: float | None = None  # without a frame, after which to end; None: never


@dataclass(frozen=True)
class InspectConfig:
    """What would be read of a folder of frames."""

    max_frames: int = 100  # read, evenly spread over what is found


@dataclass(frozen=True)
class ConvertFramesConfig:
    """Frames of any layout as flat pairs."""

    trust_pickle: bool = False  # also take the arrays out of pickles; D. 53


@dataclass(frozen=True)
class DoctorConfig:
    """What a machine should have, and how close its grasps must be to those expected (D. 76)."""

    min_free_memory: float = 2e9  # bytes
    min_free_disk: float = 1e9  # bytes
    max_product_error: float = 1e-4  # of a GPU, relative to the largest number
    max_shift: float = 0.001  # metres, of a grasp, and of its width
    max_turn: float = 0.035  # radians
    min_agreeing: float = 0.85  # share of the expected grasps


@dataclass(frozen=True)
class ExportConfig:
    """Grasps in the formats of other tools."""

    to: str = "graspnet"
    gripper: str = ""  # the one that `infer` used


@dataclass(frozen=True)
class ViewConfig:
    """Frames as pages to turn around in a browser."""

    gripper: str = ""  # the one that `infer` used
    max_pixels: int = 410_000  # D. 72: of a frame's, 848x480; a page takes some 10 bytes a pixel
    max_grasps: int = 4000  # of a frame's, the best of each region first; some 300 bytes each
    picture_width: int = 320  # pixels, of the index's pictures
