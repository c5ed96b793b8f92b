"""A frame of two things on a table, and a detector that needs no networks."""

from dataclasses import replace

import numpy as np

from pipelines.configs import InferConfig
from symgrasp import GraspDetector
from tests.geometry.tabletops import CAMERA, Box, Can, render

DEPTH = render([Can(0.035, 0.12), Box((0.05, 0.05, 0.05), (0.15, 0, 0))])[0]
COLOR = np.random.default_rng(0).integers(0, 255, (*DEPTH.shape, 3), np.uint8)
LENS = CAMERA.lens


def light_detector(gripper="rg2"):
    """A `GraspDetector` of the baseline without networks."""
    return GraspDetector(gripper, settings=InferConfig(regions="geometric", method="planar"))


def doubtful_detector(gripper="rg2", sure=0):
    """A detector whose grasps after the first `sure` ones are not worth trying."""
    detector = light_detector(gripper)

    def found(*frame):
        grasps = detector(*frame)
        return replace(grasps, worth_trying=np.arange(len(grasps)) < sure)

    return found
