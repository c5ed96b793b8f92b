"""Rules and numbers behind `infer`, each with a way to switch it off, for the leave-one-out.

Settings of `--set` leave a rule out, or a constant or function of the code that is replaced for the
run. Constants of compiled loops cannot be replaced and are not listed. The rules that a
leave-one-out deleted are in docs/experiments/leave-one-out.md.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import compress
from math import inf, pi
from typing import Any, TypeVar

import numpy as np

from pipelines.array_types import Indices
from pipelines.configs import InferConfig
from pipelines.configs.presets import preset_settings
from pipelines.configs.settings import changed, settings_of
from pipelines.errors import UnknownNameError
from pipelines.geometry.symmetry import ReflectionSymmetry, RotationSymmetry, SymmetrySlots
from pipelines.grasping.passes import Pass
from pipelines.grasping.planner import RegionPlanner
from pipelines.grasping.symmetries.axis_candidates import starting_axes
from pipelines.grasping.symmetries.plane_candidates import candidate_planes

Kind = TypeVar("Kind")
Starts = tuple[list[Kind], Indices]  # symmetries to fit, and their sources

EVERY_PASS = RegionPlanner.passes
EVERY_RULE = "all"  # key of the run with every rule
FAR = 10.0  # metres: planes there are never likely

SYMMETRY = "selection.symmetry."
CANDIDATES = "selection.candidates."
FEASIBILITY = "selection.feasibility."
RANKING = "selection.ranking."
GRASPING = "pipelines.grasping."
PLANAR = f"{GRASPING}candidates.planar."
FITS = f"{GRASPING}symmetries."
AXES = "axis_evidence.starting_axes"
PLANES = "plane_evidence.candidate_planes"
FACES = "plane_candidates.face_directions"
LEVEL = "plane_candidates.level_directions"
PIECES = "inference.frame_grasps.Planner._grasps_on_piece"
PASSES = "planner.RegionPlanner.passes"
TURNS = "symmetries.completion.COMPLETING_TURNS"
EXTENTS = ("region.max_cut_extent", "region.max_extent")


@dataclass(frozen=True)
class Rule:
    """One rule or number, or a group that acts together.

    Attributes:
        key: key in the names of files.
        meaning: the part that is left out, or made neutral.
        settings: settings that leave the rule out, by dotted name.
        replaced: dotted names of constants and functions of the code -> their replacements.
        base: key of the run of the comparison.
    """

    key: str
    meaning: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    replaced: Mapping[str, object] = field(default_factory=dict)
    base: str = EVERY_RULE


RuleRow = tuple[str, str, str, Any]  # key, meaning, name of a setting or of the code, other value


def settings_under(prefix: str, *rows: RuleRow) -> Iterator[Rule]:
    """Yield a rule for each of `rows`, which gives a setting under `prefix` another value."""
    for key, meaning, name, value in rows:
        yield Rule(key, meaning, {f"{prefix}{name}": value})


def code_under(prefix: str, *rows: RuleRow) -> Iterator[Rule]:
    """Yield a rule for each of `rows`, which replaces a name of the code under `prefix`."""
    for key, meaning, name, value in rows:
        yield Rule(key, meaning, replaced={f"{prefix}{name}": value})


def none_at_all(*_: object) -> list[Any]:
    """Return an empty list of candidates, for any arguments."""
    return []


def nothing(*_: object) -> None:
    """Return None, for any arguments."""


def axes_without(left_out: Sequence[int]) -> Callable[..., Starts[RotationSymmetry]]:
    """Return `starting_axes` without the axes at the indices `left_out` of its list."""

    def axes(*arguments: Any) -> Starts[RotationSymmetry]:  # noqa: ANN401 - any argument
        found, sources = starting_axes(*arguments)
        kept = np.array([place not in left_out for place in range(len(found))], np.bool_)
        return list(compress(found, kept)), sources[kept]

    return axes


def planes_without_axis_point(
    slots: SymmetrySlots,
    axis: RotationSymmetry,
    *more: Any,  # noqa: ANN401 - any argument
) -> Starts[ReflectionSymmetry]:
    """Return `candidate_planes`, with the planes through the axis far from the region."""
    far = RotationSymmetry(axis.direction, axis.point + FAR)
    return candidate_planes(slots, far, *more)


def without_doubtful(planner: RegionPlanner) -> tuple[Pass, ...]:
    """Return the passes over a region, without the pass across doubtful symmetries."""
    return EVERY_PASS(planner)[:2]


SELECTION = (
    *settings_under(
        SYMMETRY,
        ("no-confidence", "least confidence of symmetries", "min_confidence", 0.0),
        ("no-completion", "completion of the unseen side", "min_completion_confidence", 1.0),
        ("no-neighbours", "completion of neighbours", "min_neighbor_confidence", 1.0),
        ("completion-0.3", "own bound of completion", "min_completion_confidence", 0.3),
        ("neighbours-0.5", "neighbours' bound of completion", "min_neighbor_confidence", 0.5),
    ),
    *settings_under(
        CANDIDATES,
        ("no-affordance", "affordance of points, as threshold", "min_affordance", 0.0),
        ("pair-spacing", "spacing of contact pairs", "pair_spacing", 0.0005),
        ("all-pairs", "limit of contact pairs", "max_pairs", 4096),
    ),
    *settings_under(
        FEASIBILITY,
        ("min-width", "least width", "min_width", 1e-4),
        ("min-enclosed", "least enclosed height", "min_enclosed", 0.0),
        ("table-distance", "distance of tips and table", "min_table_distance", 0.0),
        ("approach-angle", "approach angle to the table's normal", "max_approach_angle", pi),
        ("hidden-angle", "approach angle to the view ray", "max_hidden_angle", pi),
        ("view-angle", "own bound of that angle without a table", "max_view_angle", 1.92),
        ("body-margin", "margin of the gripper's bodies", "body_margin", 0.0),
        ("points-inside", "noise points that bodies may hold", "max_points_inside", 0),
        ("approach-path", "free approach path", "approach_distance", 0.0),
        ("no-opening", "opening margin", "opening_margins", ()),
        ("one-opening", "smaller opening margin", "opening_margins", (0.008,)),
        ("no-enclosing", "contacts about all seen points", "encloses_seen_points", False),
        ("opening-share", "largest opening margin, by width", "opening_margin_share", 1.0),
    ),
    *settings_under(
        "sensor.",
        ("behind", "tolerance of counterparts before the surface", "behind_tolerance", 0.0),
        ("noise", "noise of depth at counterparts", "depth_noise", 0.0),
    ),
    *settings_under(
        RANKING,
        ("all-ranked", "limit of ranked grasps", "max_ranked", 1024),
        ("stability", "least stability for the critic", "critic_min_stability", 0.0),
        ("stability-0.85", "own bound of stability for the critic", "critic_min_stability", 0.85),
        ("torque", "torque of the weight", "half_torque_arm", 1e3),
        ("alike", "suppression of alike grasps", "nms_distance", 0.0),
        ("alternatives", "other kinds after a good grasp", "alternatives", 0),
        ("always-planar", "expectation that leaves further passes out", "sufficient", 1.0),
        ("rarely-planar", "further passes where some grasp is found", "sufficient", 0.0),
        ("eq8", "grasp critic; Eq. 8 ranks", "by", "eq8"),
    ),
    *(
        Rule(key, meaning, {f"{RANKING}by": "eq8", f"{RANKING}{name}": 0.0}, base="eq8")
        for key, meaning, name in (
            ("eq8-unseen", "visible fraction in Eq. 8", "weight_unseen"),
            ("eq8-stability", "least stability for Eq. 8", "min_stability"),
        )
    ),
    *code_under(
        GRASPING,
        ("no-doubtful", "pass across doubtful symmetries", PASSES, without_doubtful),
        ("off-centre", "less stability off the centre", "planner.OFF_CENTER", 0.0),
        ("border", "border of the image", "feasibility.image_border.ImageBorder.of", nothing),
        ("stray", "stray pixels left out", "scene.STRAY", inf),
        ("fewer-turns", "completing turns by 45 degrees", TURNS, np.radians([90.0, 180.0, 270.0])),
    ),
    *code_under(
        PLANAR,
        ("planar-tilts", "planar approaches between normal and view ray", "TILTS", (0.0, 1.0)),
        ("planar-slices", "every second planar slice", "SLICE_DEPTHS", (0.006, 0.025, 0.08)),
        ("planar-angles", "planar turns by 20 degrees", "ANGLES", np.radians([0.0, 40.0, -40.0])),
        ("planar-turns", "planar approaches turned about the contacts", "ANGLES", np.zeros(1)),
        ("planar-hidden", "penalty of outlines turned away", "HIDDEN_PENALTY", 0.0),
        ("planar-table", "planar slices lifted off the table", "STEEP_APPROACH", 2.0),
    ),
)
SYMMETRIES = (
    *code_under(
        FITS,
        ("axes-spread", "axes of the points' spread", AXES, axes_without((1, 2, 3))),
        ("axes-face", "axis of the largest face", AXES, axes_without((4,))),
        ("axes-up", "upright axis through the predicted point", AXES, axes_without((5,))),
        ("axes-outline", "upright axis through the outline's middle", AXES, axes_without((6,))),
        ("axes-lying", "lying axes", AXES, axes_without((7, 8, 9, 10))),
        ("planes-network", "predicted planes", "plane_candidates.REFLECTION_SLOTS", ()),
        ("planes-axis", "planes through the axis", PLANES, planes_without_axis_point),
        ("planes-faces", "planes of the largest face's box", FACES, none_at_all),
        ("planes-sides", "planes of the other faces", "region_shape.MIN_SIDE_POINTS", inf),
        ("planes-level", "upright planes of the outline from above", LEVEL, none_at_all),
        ("rivals", "angle between two planes at least", "plane_evidence.RIVALS", np.radians(8.0)),
    ),
)
REGIONS = (
    *settings_under(
        "",
        ("foreground", "share of a detection above the table", "min_foreground", 0.0),
        ("uncovered", "share of a depth region left free", "min_uncovered", 0.0),
        ("ratings", "improbable regions left out", "min_rating", 0.0),
        ("pieces", "detections taken apart", "min_piece_share", 1.0),
    ),
    *settings_under(
        "region.",
        ("small-support", "least seen area of a support plane", "min_support_area", 0.0),
        ("floating", "largest gap between table and region", "max_floating", inf),
        ("strips", "strips along the image's border", "max_border", inf),
        ("cut-extent", "own largest extent of cut regions", "max_cut_extent", 0.45),
        ("creases", "concave creases part regions", "crease_fold", 2.0),
        ("crease-reach", "longest chord of a crease", "crease_reach", inf),
        ("height", "largest height", "max_height", inf),
        ("beneath", "pixels beneath a plane count against it", "beneath_weight", 0.0),
        ("plane-share", "least share of a plane", "min_plane_share", 0.0),
        ("range", "depth behind the nearest surfaces", "max_range", inf),
    ),
    Rule("extent", "largest extents of regions", dict.fromkeys(EXTENTS, inf)),
    *code_under(
        "pipelines.",
        ("piecewise", "planar grasps of pieces", PIECES, lambda _planner, plan, *_: plan),
        ("lids", "lids are no tables", "tabletop.tabletop.MOST_SIDES", inf),
        ("sparse", "filling of sparse depth", "tabletop.sparse_depth.DENSE", 0.0),
    ),
)
# Departures from the paper, each undone alone: the rows of docs/method/departures.md.
PRINTED = {
    "printed-regions": ("regions of the detector alone", ("regions",)),
    "printed-masks": ("masks as detected", ("clip_detections", "min_foreground")),
    "printed-symmetries": ("symmetries as predicted", (f"{SYMMETRY}is_fitted",)),
    "printed-pairs": ("each point and its counterpart is a pair", (CANDIDATES,)),
    "printed-collision": (
        "collision with the input points",
        (
            f"{FEASIBILITY}min_enclosed",
            f"{FEASIBILITY}scene_resolution",
            f"{FEASIBILITY}body_margin",
            f"{FEASIBILITY}max_points_inside",
            f"{FEASIBILITY}approach_distance",
            f"{SYMMETRY}min_completion_confidence",
            f"{SYMMETRY}min_neighbor_confidence",
        ),
    ),
    "printed-limits": (
        "grasps from below the table, from behind, beyond the image",
        (
            f"{FEASIBILITY}keeps_off_plane",
            f"{FEASIBILITY}keeps_within_image",
            f"{FEASIBILITY}max_view_angle",
        ),
    ),
    "printed-openings": (
        "contacts as predicted",
        (f"{FEASIBILITY}opening_margins", f"{FEASIBILITY}encloses_seen_points"),
    ),
    "printed-ranking": ("Eq. 8 alone ranks", (RANKING,)),
}


def printed_settings() -> dict[str, Any]:
    """Return the settings of `infer` that the preset `paper` changes, by dotted name."""
    ours, paper = InferConfig(), changed(InferConfig(), preset_settings("paper", "infer"))
    pairs = zip(settings_of(ours), settings_of(paper), strict=True)
    return {theirs.name: theirs.value for own, theirs in pairs if own.value != theirs.value}


def departures() -> tuple[Rule, ...]:
    """Return a rule for each of `PRINTED`, with the settings of the preset `paper`."""
    printed = printed_settings()
    return tuple(
        Rule(key, meaning, {name: value for name, value in printed.items() if name.startswith(of)})
        for key, (meaning, of) in PRINTED.items()
    )


DEPARTURES = (*departures(), Rule("printed", "all of these", printed_settings()))
RULES = (Rule(EVERY_RULE, "nothing"), *SELECTION, *SYMMETRIES, *REGIONS, *DEPARTURES)


def rules_named(keys: Sequence[str]) -> tuple[Rule, ...]:
    """Return the rules of `keys` and of their comparisons; all rules if `keys` is empty.

    Raises:
        UnknownNameError: no rule has this key.
    """
    known = {rule.key: rule for rule in RULES}
    for key in keys:
        if key not in known:
            raise UnknownNameError("rule", key, tuple(known))
    wanted = {EVERY_RULE, *keys, *(known[key].base for key in keys)}
    return tuple(rule for rule in RULES if not keys or rule.key in wanted)
