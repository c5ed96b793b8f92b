"""Evaluation of grasps: ground truth, predictions, baselines, figures, tables."""
