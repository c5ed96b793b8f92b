"""Rules and numbers behind `infer`, each with a way to switch it off, for the leave-one-out.

Settings of `--set` leave a rule out, or a constant or function of the code that is replaced for the
run. Constants of compiled loops cannot be replaced and are not listed. The rules that a
leave-one-out deleted are in docs/experiments/leave-one-out.md.
"""

from collections.abc import Callable, Mapping, Sequence
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
from pipelines.grasping.symmetries.grounding import starting_axes
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
CHECKS = f"{GRASPING}feasibility."
FITS = f"{GRASPING}symmetries."


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


def passes_without_doubtful(planner: RegionPlanner) -> tuple[Pass, ...]:
    """Return the passes over a region, without the pass across doubtful symmetries."""
    return EVERY_PASS(planner)[:2]


SELECTION = (
    Rule(
        "no-doubtful",
        "pass across doubtful symmetries",
        replaced={f"{GRASPING}planner.RegionPlanner.passes": passes_without_doubtful},
    ),
    Rule("no-confidence", "least confidence of symmetries", {f"{SYMMETRY}min_confidence": 0.0}),
    Rule(
        "no-completion",
        "completion of the own unseen side",
        {f"{SYMMETRY}min_completion_confidence": 1.0},
    ),
    Rule(
        "no-neighbours",
        "completion of neighbours' unseen sides",
        {f"{SYMMETRY}min_neighbour_confidence": 1.0},
    ),
    Rule(
        "completion-0.3",
        "own bound of completion; 0.3 as for neighbours",
        {f"{SYMMETRY}min_completion_confidence": 0.3},
    ),
    Rule(
        "neighbours-0.5",
        "neighbours' bound of completion; 0.5 as for the own",
        {f"{SYMMETRY}min_neighbour_confidence": 0.5},
    ),
    Rule(
        "fewer-turns",
        "completing turns by 45 degrees; 90",
        replaced={f"{FITS}completion.COMPLETING_TURNS": np.radians([90.0, 180.0, 270.0])},
    ),
    Rule(
        "no-affordance",
        "affordance of points, as threshold",
        {f"{CANDIDATES}min_affordance": 0.0},
    ),
    Rule("pair-spacing", "spacing of contact pairs", {f"{CANDIDATES}pair_spacing": 0.0005}),
    Rule("all-pairs", "limit of contact pairs", {f"{CANDIDATES}max_pairs": 4096}),
    Rule(
        "off-centre",
        "less stability off the centre",
        replaced={f"{GRASPING}planner.OFF_CENTRE": 0.0},
    ),
    Rule("min-width", "least width", {f"{FEASIBILITY}min_width": 1e-4}),
    Rule("min-enclosed", "least enclosed height", {f"{FEASIBILITY}min_enclosed": 0.0}),
    Rule("table-distance", "distance of tips and table", {f"{FEASIBILITY}min_table_distance": 0.0}),
    Rule(
        "approach-angle",
        "largest approach angle to the table's normal",
        {f"{FEASIBILITY}max_approach_angle": pi},
    ),
    Rule(
        "hidden-angle",
        "largest approach angle to the view ray over a table",
        {f"{FEASIBILITY}max_hidden_angle": pi},
    ),
    Rule(
        "view-angle",
        "own bound of that angle without a table; 1.92",
        {f"{FEASIBILITY}max_view_angle": 1.92},
    ),
    Rule("body-margin", "margin of the gripper's bodies", {f"{FEASIBILITY}body_margin": 0.0}),
    Rule(
        "points-inside", "noise points that bodies may hold", {f"{FEASIBILITY}max_points_inside": 0}
    ),
    Rule("approach-path", "free approach path", {f"{FEASIBILITY}approach_distance": 0.0}),
    Rule("no-opening", "opening margin", {f"{FEASIBILITY}opening_margins": ()}),
    Rule("one-opening", "smaller opening margin", {f"{FEASIBILITY}opening_margins": (0.008,)}),
    Rule(
        "opening-share",
        "opening margin of a share of the width at most",
        {f"{FEASIBILITY}opening_margin_share": 1.0},
    ),
    Rule(
        "border", "border of the image", replaced={f"{CHECKS}image_border.ImageBorder.of": nothing}
    ),
    Rule(
        "behind", "tolerance of counterparts before the surface", {"sensor.behind_tolerance": 0.0}
    ),
    Rule("noise", "noise of depth at counterparts", {"sensor.depth_noise": 0.0}),
    Rule("all-ranked", "limit of ranked grasps", {f"{RANKING}max_ranked": 1024}),
    Rule("stability", "least stability for the critic", {f"{RANKING}critic_min_stability": 0.0}),
    Rule(
        "stability-0.85",
        "own bound of stability for the critic; 0.85 as for Eq. 8",
        {f"{RANKING}critic_min_stability": 0.85},
    ),
    Rule("torque", "torque of the weight", {f"{RANKING}half_torque_arm": 1e3}),
    Rule("alike", "suppression of alike grasps", {f"{RANKING}nms_distance": 0.0}),
    Rule("alternatives", "other kinds after a good grasp", {f"{RANKING}alternatives": 0}),
    Rule(
        "always-planar", "expectation that leaves further passes out", {f"{RANKING}sufficient": 1.0}
    ),
    Rule(
        "rarely-planar", "further passes where some grasp is found", {f"{RANKING}sufficient": 0.0}
    ),
    Rule(
        "planar-tilts",
        "planar approaches between normal and view ray",
        replaced={f"{PLANAR}TILTS": (0.0, 1.0)},
    ),
    Rule(
        "planar-slices",
        "every second planar slice",
        replaced={f"{PLANAR}SLICE_DEPTHS": (0.006, 0.025, 0.08)},
    ),
    Rule(
        "planar-angles",
        "planar approaches turned by 20 degrees",
        replaced={f"{PLANAR}ANGLES": np.radians([0.0, 40.0, -40.0])},
    ),
    Rule(
        "planar-turns",
        "planar approaches turned about the contact line",
        replaced={f"{PLANAR}ANGLES": np.zeros(1)},
    ),
    Rule(
        "planar-hidden",
        "penalty of outlines turned away",
        replaced={f"{PLANAR}HIDDEN_PENALTY": 0.0},
    ),
    Rule(
        "planar-table",
        "planar slices lifted off the table",
        replaced={f"{PLANAR}STEEP_APPROACH": 2.0},
    ),
    Rule("stray", "stray pixels left out", replaced={f"{GRASPING}scene.STRAY": inf}),
    Rule("eq8", "grasp critic; Eq. 8 ranks", {f"{RANKING}by": "eq8"}),
    Rule(
        "eq8-unseen",
        "visible fraction in Eq. 8",
        {f"{RANKING}by": "eq8", f"{RANKING}weight_unseen": 0.0},
        base="eq8",
    ),
    Rule(
        "eq8-stability",
        "least stability for Eq. 8",
        {f"{RANKING}by": "eq8", f"{RANKING}min_stability": 0.0},
        base="eq8",
    ),
)
SYMMETRIES = (
    Rule(
        "axes-spread",
        "axes of the points' spread",
        replaced={f"{FITS}grounding.starting_axes": axes_without((1, 2, 3))},
    ),
    Rule(
        "axes-face",
        "axis of the largest face",
        replaced={f"{FITS}grounding.starting_axes": axes_without((4,))},
    ),
    Rule(
        "axes-up",
        "upright axis through the predicted point",
        replaced={f"{FITS}grounding.starting_axes": axes_without((5,))},
    ),
    Rule(
        "axes-outline",
        "upright axis through the outline's middle",
        replaced={f"{FITS}grounding.starting_axes": axes_without((6,))},
    ),
    Rule(
        "axes-lying",
        "lying axes",
        replaced={f"{FITS}grounding.starting_axes": axes_without((7, 8, 9, 10))},
    ),
    Rule(
        "planes-network",
        "predicted planes",
        replaced={f"{FITS}plane_candidates.REFLECTION_SLOTS": ()},
    ),
    Rule(
        "planes-axis",
        "planes through the axis",
        replaced={f"{FITS}plane_evidence.candidate_planes": planes_without_axis_point},
    ),
    Rule(
        "planes-faces",
        "planes of the largest face's box",
        replaced={f"{FITS}plane_candidates.face_directions": none_at_all},
    ),
    Rule(
        "planes-sides",
        "planes of the other faces",
        replaced={f"{FITS}plane_candidates.MIN_SIDE_POINTS": inf},
    ),
    Rule(
        "planes-level",
        "upright planes of the outline from above",
        replaced={f"{FITS}plane_candidates.level_directions": none_at_all},
    ),
    Rule(
        "rivals",
        "angle between two planes at least",
        replaced={f"{FITS}plane_evidence.RIVALS": np.radians(8.0)},
    ),
)
REGIONS = (
    Rule("foreground", "share of a detection above the table", {"min_foreground": 0.0}),
    Rule("uncovered", "share of a depth region left free", {"min_uncovered": 0.0}),
    Rule("ratings", "improbable regions left out", {"min_rating": 0.0}),
    Rule("pieces", "detections taken apart", {"min_piece_share": 1.0}),
    Rule(
        "piecewise",
        "planar grasps of pieces",
        replaced={
            "pipelines.inference.frame_grasps.Planner._grasps_on_piece": lambda _self, plan, *_: (
                plan
            )
        },
    ),
    Rule("small-support", "least seen area of a support plane", {"region.min_support_area": 0.0}),
    Rule("floating", "largest gap between table and region", {"region.max_floating": inf}),
    Rule("lids", "lids are no tables", replaced={"pipelines.tabletop.tabletop.MOST_SIDES": inf}),
    Rule("strips", "strips along the image's border", {"region.max_border": inf}),
    Rule("cut-extent", "own largest extent of cut regions", {"region.max_cut_extent": 0.45}),
    Rule(
        "extent",
        "largest extents of regions",
        {"region.max_cut_extent": inf, "region.max_extent": inf},
    ),
    Rule("creases", "concave creases part regions", {"region.crease_fold": 2.0}),
    Rule("crease-reach", "longest chord of a crease", {"region.crease_reach": inf}),
    Rule("height", "largest height", {"region.max_height": inf}),
    Rule("beneath", "pixels beneath a plane count against it", {"region.beneath_weight": 0.0}),
    Rule("plane-share", "least share of a plane", {"region.min_plane_share": 0.0}),
    Rule("range", "depth behind the nearest surfaces", {"region.max_range": inf}),
    Rule(
        "sparse", "filling of sparse depth", replaced={"pipelines.tabletop.sparse_depth.DENSE": 0.0}
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
            f"{SYMMETRY}min_neighbour_confidence",
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
    "printed-openings": ("contacts as predicted", (f"{FEASIBILITY}opening_margins",)),
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
