"""Grasps judged, tried and compared."""

from dataclasses import dataclass


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
