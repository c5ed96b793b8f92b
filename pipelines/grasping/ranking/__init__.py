"""Ranking of feasible grasps: Eq. 8, or the quality that a critic expects."""
