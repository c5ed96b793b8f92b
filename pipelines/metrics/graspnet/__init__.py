"""GraspNet's metrics, verdict for verdict as graspnetAPI."""
