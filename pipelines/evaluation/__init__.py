"""What `evaluate` is made of: ground truth, predictions, baselines, records, figures, tables."""
