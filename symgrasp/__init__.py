"""Grasps for parallel grippers from one RGB-D image: arrays in, ranked grasps out.

    from symgrasp import GraspDetector, bundled_frame

    detector = GraspDetector(gripper="franka")
    color, depth, intrinsics = bundled_frame()
    for grasp in detector(color, depth, intrinsics)[:3]:
        print(grasp.rank_score, grasp.opening, grasp.pose())

Importing this package is cheap: torch, numpy and the models load when a name is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from pipelines.errors import SymgraspError

if TYPE_CHECKING:
    from symgrasp.bundled_frames import bundled_frame
    from symgrasp.detector import GraspDetector
    from symgrasp.grasps import Grasp, Grasps
    from symgrasp.grasps_files import read_grasps
    from symgrasp.regions import FoundRegion, FoundSymmetry

    __version__: str

__all__ = [
    "FoundRegion",
    "FoundSymmetry",
    "Grasp",
    "GraspDetector",
    "Grasps",
    "SymgraspError",
    "__version__",
    "bundled_frame",
    "read_grasps",
]

_MODULES = {
    "FoundRegion": "symgrasp.regions",
    "FoundSymmetry": "symgrasp.regions",
    "Grasp": "symgrasp.grasps",
    "GraspDetector": "symgrasp.detector",
    "Grasps": "symgrasp.grasps",
    "bundled_frame": "symgrasp.bundled_frames",
    "read_grasps": "symgrasp.grasps_files",
}


def __getattr__(name: str) -> object:
    if name == "__version__":
        from pipelines.storage.provenance import version  # noqa: PLC0415 - loads h5py

        return version()
    if name not in _MODULES:
        raise AttributeError(f"module 'symgrasp' has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return __all__
