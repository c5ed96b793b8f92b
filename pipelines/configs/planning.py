"""Settings of one frame's grasp planning: sensor, regions from depth, selection, limits."""

from dataclasses import dataclass, field
from math import inf, pi
from typing import Literal

from pipelines.configs.declaration import BY_EYE, choice, setting

RankingMethod = Literal["critic", "eq8"]
ReferenceFrame = Literal["camera", "table"]
Averaging = Literal["median", "mean"]
SymmetrySource = Literal["network", "network+shape", "shape"]

ROBOT = "user's robot"


@dataclass(frozen=True)
class ColorConfig:
    """Pieces that stand out from the support plane by colour: thin things, things without depth."""

    is_used: bool = choice(True, "Find regions by colour beside those from depth.", "D. 131")
    min_contrast: float = setting(
        9.0, "Lab", "Least difference of a thing's colour from the table's.", BY_EYE
    )
    lightness_weight: float = setting(
        0.5, "weight", "Weight of lightness, which shadows change, against hue.", BY_EYE
    )
    deviations: float = setting(
        3.5, "factor", "The same difference, by the standard deviation of the table.", BY_EYE
    )
    window: float = setting(
        0.25, "share", "Side of the window of the table's mean colour, of the image.", BY_EYE
    )
    min_pixels: int = setting(150, "px", "Least number of pixels of a piece.", BY_EYE, low=1)
    max_slenderness: float = setting(
        45.0, "factor", "Length by width beyond which a piece is cables and what they join.", BY_EYE
    )
    min_thickness: float = setting(
        7.0, "px", "Least width of a thing where it is widest; a cable has less.", BY_EYE
    )
    min_confined: float = setting(
        0.6, "share", "Share of a region within a piece of colour that may complete it.", BY_EYE
    )
    max_low: float = setting(
        2.5,
        "factor",
        "Height by that of noise up to which a region continues where the table is measured.",
        BY_EYE,
    )
    min_convexity: float = setting(
        0.9, "share", "Share of its convex outline that joins the low regions of a piece.", BY_EYE
    )


@dataclass(frozen=True)
class RegionConfig:
    """Regions found without a network: things that stand on the support plane."""

    max_distance: float = setting(2.0, "m", "Largest distance from the camera.", BY_EYE)
    max_range: float = setting(
        1.2, "m", "Depth beyond the nearest surfaces behind which all is background.", BY_EYE
    )
    plane_tolerance: float = setting(
        0.010,
        "1/m",
        "Distance from the support plane, in inverse depth; metres at one metre.",
        "D. 30",
    )
    min_plane_share: float = setting(
        0.08, "share", "Share of the near pixels below which a plane supports nothing.", BY_EYE
    )
    min_support_area: float = setting(
        0.008, "m2", "Seen area below which a plane is a finger before the lens.", "D. 106"
    )
    beneath_weight: float = setting(
        2.0, "weight", "Weight of a near pixel beneath a plane against one on it.", BY_EYE
    )
    support_margin: float = setting(
        0.03, "m", "Distance that objects may stand out over the plane's border.", BY_EYE
    )
    min_height: float = setting(0.006, "m", "Least height above the plane.", BY_EYE)
    max_height: float = setting(
        0.5, "m", "Height above the plane beyond which a thing is an arm or a wall.", BY_EYE
    )
    min_pixels: int = setting(200, "px", "Least number of pixels of a region.", BY_EYE, low=1)
    max_extent: float = setting(0.45, "m", "Largest diagonal of an object.", BY_EYE)
    max_cut_extent: float = setting(
        0.2, "m", "Largest diagonal of what the border of the image cuts off.", BY_EYE
    )
    max_cut_height: float = setting(
        0.05, "m", "Height up to which such a thing, a book say, may be as large as any.", BY_EYE
    )
    min_over_support: float = setting(
        0.25, "share", "Share of a thing that lies over the support's visible extent.", "D. 132"
    )
    min_support_behind: float = setting(
        0.02,
        "share",
        "Share of the support behind a large steep surface; a wall has less.",
        "D. 132",
    )
    max_border: float = setting(
        3.0,
        "px2/px",
        "Squared pixels on the image's border, by pixel, of a strip along it.",
        BY_EYE,
    )
    max_floating: float = setting(
        0.05, "m", "Largest gap between the table and the lowest visible part.", "D. 110"
    )
    depth_step: float = setting(
        0.012, "share", "Step between neighbours that parts surfaces, of their depth.", "D. 30"
    )
    normal_radius: int = setting(4, "px", "Radius that normals are smoothed over.", BY_EYE, low=1)
    crease_fold: float = setting(
        0.6, "factor", "2 sin(fold / 2) beyond which a concave crease parts regions.", "D. 30"
    )
    crease_reach: float = setting(
        4.5, "factor", "Length of a crease's chord, by that of a level chord, at most.", BY_EYE
    )
    color: ColorConfig = field(default_factory=ColorConfig)


@dataclass(frozen=True)
class SensorConfig:
    """Errors of the depth camera, where a point known by symmetry is checked against the image."""

    behind_tolerance: float = setting(
        0.005, "m", "Distance that a counterpart may float before the seen surface.", "D. 6"
    )
    depth_noise: float = setting(
        0.003, "m", "Noise of depth at one metre; it grows with the square of depth.", "D. 6"
    )


@dataclass(frozen=True)
class SymmetryConfig:
    """Belief in the predicted symmetries of a region."""

    is_fitted: bool = choice(
        True, "Fit predicted symmetries to the seen surface; the paper does not.", "D. 31"
    )
    candidates: SymmetrySource = choice(
        "network+shape",
        "Source of the symmetries that are fitted: the network, the region's shape, or both.",
        "D. 65, D. 140",
    )
    averaging: Averaging = choice(
        "median",
        "Symmetry of a region, of its points' votes: median, by affordance, or mean.",
        "D. 4",
    )
    min_existence: float = setting(
        0.5, "share", "Least existence of a symmetry that is not fitted.", "D. 4"
    )
    min_confidence: float = setting(
        0.2, "share", "Least confidence of a fitted symmetry that grasps rest on.", "D. 66, D. 85"
    )
    min_doubtful_confidence: float = setting(
        0.03, "share", "The same where all other grasps of the region are poor.", "D. 88"
    )
    min_completion_confidence: float = setting(
        0.5, "share", "Least confidence of a symmetry that completes the unseen side.", "D. 32"
    )
    min_neighbour_confidence: float = setting(
        0.3, "share", "The same of a neighbour's, whose completed side is an obstacle.", "D. 85"
    )

    @property
    def least_confidence(self) -> float:
        """Confidence above which a symmetry is grasped across before all other grasps."""
        return self.min_confidence if self.is_fitted else self.min_existence


@dataclass(frozen=True)
class CandidateConfig:
    """Contact pairs of a region and the approaches to try at each (Sec. III-E, III-F)."""

    min_affordance: float = setting(
        0.5, "share", "Least affordance of a point that a grasp is planned from.", "Sec. III-F"
    )
    max_pairs: int = setting(256, "count", "Contact pairs tried in a region.", "D. 85", low=1)
    pair_spacing: float = setting(
        0.006, "m", "Least distance between the first contacts of pairs that are tried.", "D. 85"
    )
    max_contact_angle: float = setting(
        0.7, "rad", "Largest angle between a contact's normal and the contact line.", "D. 79"
    )
    num_approach_angles: int = setting(
        12,
        "count",
        "Approach directions tried about a contact line, M of Sec. III-F.",
        BY_EYE,
        low=1,
    )


@dataclass(frozen=True)
class FeasibilityConfig:
    """Checks that a grasp must pass at its region (Sec. III-F)."""

    min_width: float = setting(0.003, "m", "Distance below which two contacts are one.", BY_EYE)
    min_enclosed: float = setting(
        0.004, "m", "Least height of the object between the fingers.", BY_EYE
    )
    min_table_distance: float = setting(
        0.004, "m", "Least distance between finger tips and table.", BY_EYE
    )
    keeps_off_plane: bool = choice(
        True, "Keep the gripper above the support plane, where it is seen and where not.", BY_EYE
    )
    keeps_within_image: bool = choice(
        True, "Keep off the space beyond the image where its border cuts the region off.", "D. 109"
    )
    max_approach_angle: float = setting(
        1.75, "rad", "Largest angle between approach and the table's inward normal.", BY_EYE
    )
    max_view_angle: float = setting(
        1.05, "rad", "Largest angle between approach and view ray where no table is seen.", BY_EYE
    )
    max_hidden_angle: float = setting(
        1.92, "rad", "The same over a table: no approach from behind what is seen.", BY_EYE
    )
    scene_resolution: float = setting(
        0.003, "m", "Spacing that the scene is thinned to for collisions.", BY_EYE, low=1e-4
    )
    body_margin: float = setting(
        0.001, "m", "Distance that the gripper's bodies are enlarged by.", "D. 101"
    )
    max_points_inside: int = setting(
        2, "count", "Measured points that a body may hold, as noise.", "D. 87"
    )
    approach_distance: float = setting(
        0.10, "m", "Length of the approach path that must be free.", "D. 77"
    )
    opening_margins: tuple[float, ...] = setting(
        (0.008, 0.006, 0.004, 0.002), "m", "Opening margins to try, the largest first.", "D. 92"
    )
    opening_margin_share: float = setting(
        0.25, "share", "Largest opening margin, of the width.", "D. 102"
    )


@dataclass(frozen=True)
class RankingConfig:
    """Order of feasible grasps, and when other kinds of grasps are tried (Sec. III-F)."""

    by: RankingMethod = choice(
        "critic", "Order of grasps: critic, by expected quality; eq8, as the paper.", "D. 82"
    )
    clearance_cap: float = setting(
        0.05, "m", "Largest clearance b that counts in Eq. 8.", "D. 7", low=1e-4
    )
    enclosed_height_cap: float = setting(
        0.03, "m", "Largest enclosed height h that counts in Eq. 8.", "D. 7", low=1e-4
    )
    weight_clearance: float = setting(1.0, "weight", "w^b of Eq. 8.", "Sec. III-G")
    weight_height: float = setting(5.0, "weight", "w^h of Eq. 8.", "Sec. III-G")
    weight_unseen: float = setting(
        0.9, "share", "Share of Eq. 8 lost where the finger tips' space is all unseen.", "D. 68"
    )
    max_ranked: int = setting(
        96, "count", "Grasps of a region and pass that are ranked, the most stable.", "D. 82", low=1
    )
    min_stability: float = setting(
        0.85, "share", "Least stability for Eq. 8, of the best candidate's.", "D. 28"
    )
    critic_min_stability: float = setting(
        0.6, "share", "Least stability for the grasp critic, of the best candidate's.", "D. 82"
    )
    nms_distance: float = setting(
        0.03, "m", "Distance below which grasps of a region are alike, as GraspNet's.", "D. 78"
    )
    nms_angle: float = setting(
        pi / 6, "rad", "Angle below which grasps of a region are alike, as GraspNet's.", "D. 78"
    )
    sufficient: float = setting(
        0.6, "share", "Expected quality from which no other kind of grasps is tried.", "D. 82"
    )

    @property
    def uses_critic(self) -> bool:
        """Whether grasps are ranked by the quality that the grasp critic expects."""
        return self.by == "critic"


@dataclass(frozen=True)
class SelectionConfig:
    """Physics-feasible grasp selection (Sec. III-F)."""

    symmetry: SymmetryConfig = field(default_factory=SymmetryConfig)
    candidates: CandidateConfig = field(default_factory=CandidateConfig)
    feasibility: FeasibilityConfig = field(default_factory=FeasibilityConfig)
    ranking: RankingConfig = field(default_factory=RankingConfig)


@dataclass(frozen=True)
class LimitsConfig:
    """Limits of a robot: where it may grasp, and from which directions; by default all."""

    box: tuple[float, ...] = setting(
        (), "m", "Corners x0,y0,z0,x1,y1,z1 of the workspace; empty for none.", ROBOT, low=-inf
    )
    box_frame: ReferenceFrame = choice(
        "camera",
        "Frame of the box; table: z up from it, its origin nearest to the camera.",
        ROBOT,
    )
    approach_cone: float = setting(
        180.0, "deg", "Largest angle between approach and approach direction.", ROBOT
    )
    approach_direction: tuple[float, float, float] = setting(
        (0.0, 0.0, -1.0),
        "direction",
        "Axis x,y,z of that cone, towards the object.",
        ROBOT,
        low=-inf,
    )
    approach_frame: ReferenceFrame = choice("table", "Frame of the approach direction.", ROBOT)
