"""Setting names of earlier versions, so that files of these versions can be read."""

from dataclasses import fields

from pipelines.configs.planning import (
    CandidateConfig,
    FeasibilityConfig,
    RankingConfig,
    SymmetryConfig,
)

# Settings of `selection` that had no group in earlier versions.
GROUPED = {
    f"selection.{each.name}": f"selection.{group}.{each.name}"
    for group, kind in (
        ("symmetry", SymmetryConfig),
        ("candidates", CandidateConfig),
        ("feasibility", FeasibilityConfig),
        ("ranking", RankingConfig),
    )
    for each in fields(kind)
}
# By the config's class: earlier dotted name -> current dotted name.
RENAMED: dict[str, dict[str, str]] = {
    "EvaluateDumpConfig": {"max_width": "clip_width"},
    "ScoreGraspsConfig": {"max_width": "clip_width"},
    "TrainConfig": {"endless.scenery.surroundings": "endless.surroundings"},
    "InferConfig": {
        **GROUPED,
        "selects_for_peers": "selects_for_compared_methods",
        "selection.ground_symmetries": "selection.symmetry.is_fitted",
        "selection.rank_by": "selection.ranking.by",
        "selection.planar_below": "selection.ranking.sufficient",
        "selection.behind_tolerance": "sensor.behind_tolerance",
        "selection.depth_noise": "sensor.depth_noise",
        "selection.min_trust": "selection.symmetry.min_confidence",
        "selection.min_completion": "selection.symmetry.min_completion_confidence",
        "selection.min_completion_beside": "selection.symmetry.min_neighbor_confidence",
        "selection.symmetry.min_neighbour_confidence": "selection.symmetry.min_neighbor_confidence",
        "selection.min_neighbour_confidence": "selection.symmetry.min_neighbor_confidence",
        "selection.spare_room": "selection.feasibility.opening_margins",
        "selection.spare_share": "selection.feasibility.opening_margin_share",
        "selection.steadiness": "selection.ranking.min_stability",
        "selection.judged_steadiness": "selection.ranking.critic_min_stability",
    },
}
NO_EFFECT = "a leave-one-out showed no effect"
NEVER_USED = "it had no effect"
# Removed settings with the reason; files of earlier versions may name them.
REMOVED: dict[str, dict[str, str]] = {
    "InferConfig": {
        "selection.weak_affordance": NO_EFFECT,
        "selection.candidates.weak_affordance": NO_EFFECT,
        "selection.symmetry.averaging": NO_EFFECT,
        "selection.candidates.max_contact_angle": NO_EFFECT,
        "selection.doubted_trust": NO_EFFECT,
        "selection.symmetry.min_doubtful_confidence": NO_EFFECT,
    },
    "TrainConfig": {
        "endless.scenery.robot_hands": NEVER_USED,
        "endless.scenery.colors": NEVER_USED,
        "endless.scenery.depth_faults": NEVER_USED,
    },
}
# Settings that weights of earlier versions lack, with the values that their networks have.
NOT_NAMED_BEFORE: dict[str, dict[str, object]] = {
    "NetworkConfig": {"pift": "spread", "sees_camera": False}
}
# Earlier values -> current values, by the current name of the setting.
RENAMED_VALUES: dict[str, dict[str, dict[str, str]]] = {
    "InferConfig": {"selection.ranking.by": {"judge": "critic"}}
}
