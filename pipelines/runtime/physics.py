"""MuJoCo without its renderer, as importing that starts a Python process to search for GLFW."""

import os

_renderer = os.environ.get("MUJOCO_GL")
os.environ["MUJOCO_GL"] = "disable"
try:
    import mujoco
finally:
    if _renderer is None:
        del os.environ["MUJOCO_GL"]
    else:
        os.environ["MUJOCO_GL"] = _renderer

__all__ = ["mujoco"]
