"""Names that settings had in earlier versions, so that files written by these are still read."""

# By the config's class: dotted name of before -> of now.
RENAMED: dict[str, dict[str, str]] = {
    "EvaluateDumpConfig": {"max_width": "clip_width"},
    "ScoreGraspsConfig": {"max_width": "clip_width"},
    "InferConfig": {
        "selection.min_trust": "selection.min_confidence",
        "selection.doubted_trust": "selection.min_doubtful_confidence",
        "selection.min_completion": "selection.min_completion_confidence",
        "selection.min_completion_beside": "selection.min_neighbour_confidence",
        "selection.spare_room": "selection.opening_margins",
        "selection.spare_share": "selection.opening_margin_share",
        "selection.steadiness": "selection.min_stability",
        "selection.judged_steadiness": "selection.critic_min_stability",
    },
}
# Settings that are no more, with the reason: files of before may name them.
REMOVED: dict[str, dict[str, str]] = {}
# Values of before -> of now, by the name of now.
RENAMED_VALUES: dict[str, dict[str, dict[str, str]]] = {
    "InferConfig": {"selection.rank_by": {"judge": "critic"}},
}
