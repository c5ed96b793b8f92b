"""MuJoCo without its renderer, whose import starts a Python process that looks for GLFW."""

import os

_chosen = os.environ.get("MUJOCO_GL")
os.environ["MUJOCO_GL"] = "disable"
try:
    import mujoco
finally:
    if _chosen is None:
        del os.environ["MUJOCO_GL"]
    else:
        os.environ["MUJOCO_GL"] = _chosen

__all__ = ["mujoco"]
