"""The evaluation of grasp dumps by GraspNet's protocol."""
