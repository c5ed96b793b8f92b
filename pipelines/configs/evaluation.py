"""Settings of the stages that score, simulate and compare grasps."""

from dataclasses import dataclass
from typing import Literal

from pipelines.configs.declaration import BY_EYE, choice, count, fraction, setting
from pipelines.configs.inference import GRIPPER_USED

BootstrapUnit = Literal["frame", "scene"]

CLIP_WIDTH = "Widest opening of graspnetAPI's gripper; wider openings are clipped to it."
MIN_VISIBLE_PIXELS = "Visible pixels below which an object is not evaluated."
MIN_REGION_SHARE = "Least share of a region's pixels on the object that the region is assigned to."


@dataclass(frozen=True)
class ScoreGraspsConfig:
    """Scores of grasps on a mesh, given as rows of graspnetAPI."""

    compatible: bool = choice(
        False, "Reproduce graspnetAPI's verdicts, with its errors on flat faces.", "D. 44"
    )
    clip_width: float = setting(0.1, "m", CLIP_WIDTH, "graspnetAPI", low=0.001, high=1.0)
    friction_grid: tuple[float, ...] = setting(
        (0.2, 0.4, 0.6, 0.8, 1.0, 1.2), "factor", "Friction coefficients tried.", "graspnetAPI"
    )


@dataclass(frozen=True)
class EvaluateConfig:
    """Metrics (Sec. IV)."""

    min_visible_pixels: int = setting(300, "px", MIN_VISIBLE_PIXELS, BY_EYE, low=1)
    symmetry_thresholds: tuple[float, ...] = fraction(
        (0.25, 0.134, 0.067), "Dense symmetry errors up to which a symmetry is found.", "D. 11"
    )
    sphere_threshold: float = setting(
        0.05, "m", "Distance of the centres up to which a sphere is found.", "Sec. IV-E"
    )
    min_region_share: float = fraction(0.3, MIN_REGION_SHARE, "D. 22")
    min_region_iou: float = fraction(
        0.25, "Least overlap with a true region whose symmetries are compared.", "D. 22"
    )
    gripper: str = choice("", GRIPPER_USED, "D. 71")


@dataclass(frozen=True)
class EvaluateDumpConfig:
    """GraspNet-1Billion's protocol on dumps of any detector; all else is fixed."""

    exact: bool = choice(False, "Exact contacts and collisions in place of graspnetAPI's.", "D. 47")
    clip_width: float = setting(0.1, "m", CLIP_WIDTH, "graspnetAPI", low=0.001, high=1.0)
    frame_stride: int = count(1, "Score every n-th frame, as `infer --frame-stride`.", "D. 46")


@dataclass(frozen=True)
class IntervalConfig:
    """Intervals of figures: a bootstrap over scenes or frames."""

    unit: BootstrapUnit = choice(
        "scene", "Unit that intervals draw: scene, because its views are alike, or frame.", "D. 151"
    )


@dataclass(frozen=True)
class CompareConfig(IntervalConfig):
    """Comparison of runs: a paired bootstrap over scenes or frames."""

    row: str = choice(
        "ours", "Row of the reports, e.g. ours or planar-critic; for a dump, a camera.", "D. 51"
    )
    resamples: int = count(2000, "Draws of the bootstrap.", BY_EYE)
    level: float = fraction(0.95, "Level of the intervals.", BY_EYE)


@dataclass(frozen=True)
class SimulateConfig:
    """Grasp success in a physics simulation (Sec. IV-A, Table III)."""

    frictions: tuple[float, ...] = setting(
        (0.3, 0.5, 0.8),
        "factor",
        "Friction coefficients of fingers and objects, one trial for each.",
        "D. 49",
        low=1e-3,
    )
    approach: float = setting(0.10, "m", "Distance moved along the approach axis.", "D. 48")
    lift: float = setting(0.15, "m", "Height that the object is lifted.", BY_EYE)
    tug: float = setting(5.0, "m/s2", "Acceleration of five tugs, added to gravity.", "D. 48")
    max_slip: float = setting(0.05, "m", "Largest slip in the gripper, closing to end.", BY_EYE)
    max_turn: float = setting(15.0, "deg", "Largest turn in the gripper, closing to end.", BY_EYE)
    grip_force: float = setting(8.0, "object weights", "Force of a finger.", "D. 49")
    max_force: float = setting(40.0, "N", "Largest force of a finger, as the RG2's.", "D. 49")
    arm_force: float = setting(60.0, "N", "Largest pushing force of the arm.", BY_EYE)
    stop_force: float = setting(
        30.0, "N", "Force on the approach path at which the arm stops.", "D. 48"
    )
    convex_enough: float = fraction(
        0.98, "Share of the hull's volume from which a model is one convex piece.", BY_EYE
    )
    concavity: float = setting(
        0.03, "factor", "Largest concavity of coacd's pieces.", BY_EYE, low=0.01, high=1.0
    )
    max_pieces: int = count(32, "Most convex pieces of a model.", BY_EYE)
    min_visible_pixels: int = setting(300, "px", MIN_VISIBLE_PIXELS, BY_EYE, low=1)
    min_region_share: float = fraction(0.3, MIN_REGION_SHARE, "D. 22")
    gripper: str = choice("", GRIPPER_USED, "D. 71")
