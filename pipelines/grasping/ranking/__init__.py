"""Ranking of feasible grasps by Eq. 8 or by a critic's expected quality."""
