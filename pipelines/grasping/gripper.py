"""The parallel gripper as three boxes in the grasp frame: two fingers and a palm."""

from copy import copy
from dataclasses import dataclass, fields
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from pipelines.array_types import Array
from pipelines.errors import ValueRangeError

NUMBER = int | float | np.integer | np.floating
GRASPNET_BACK = 0.02  # metres from the origin of GraspNet's hand back to the end of its fingers
GRASPNET_DEPTHS = 0.01, 0.04  # metres from that origin to the finger tips: least, most


@dataclass(frozen=True)
class Gripper:
    """Dimensions of a gripper in metres, along approach, closing and approach x closing.

    Attributes:
        name: name of the preset or file.
        max_opening: widest distance between the fingers' inner faces.
        finger_length: from the palm's front to the finger tips, along approach.
        finger_thickness: thickness of one finger along closing.
        finger_height: height of a finger along the binormal.
        palm_depth: depth of the palm, behind the fingers, along approach.
        palm_width: width of the palm along closing.
        palm_height: height of the palm along the binormal.
        tip_reach: distance of the tips past the contact line along approach.
        clearance: free distance between contact and open finger, each side.
        flange_to_tip: from the mounting face to the finger tips, for exporters.
    """

    name: str
    max_opening: float
    finger_length: float
    finger_thickness: float
    finger_height: float
    palm_depth: float
    palm_width: float
    palm_height: float
    tip_reach: float
    clearance: float
    flange_to_tip: float

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise ValueRangeError("name of a gripper", self.name, "a text")
        where = f"gripper {self.name}"
        for field in fields(self)[1:]:
            value = getattr(self, field.name)
            is_number = isinstance(value, NUMBER) and not isinstance(value, bool)
            if not (is_number and 0.0 <= value < 1.0):
                expected = "a length in metres (millimetres / 1000), at least 0 and below 1"
                raise ValueRangeError(f"{where}: {field.name}", value, expected)
            if isinstance(value, np.generic):  # digests and files need Python's numbers
                vars(self)[field.name] = value.item()
        if self.max_opening <= 2 * self.clearance:
            expected = "wider than two clearances"
            raise ValueRangeError(f"{where}: max_opening", self.max_opening, expected)

    @property
    def max_width(self) -> float:
        """Widest distance of contacts that the open fingers pass with their clearance."""
        return self.max_opening - 2.0 * self.clearance

    @property
    def reach(self) -> float:
        """Distance from a grasp's middle to the farthest corner of the gripper at `max_width`."""
        farthest = np.abs(self.boxes(self.max_width)).max(axis=-2)
        return float(np.linalg.norm(farthest, axis=-1).max())

    @property
    def graspnet_depth(self) -> float:
        """Depth of GraspNet's hand, from origin to finger tips, with fingers as long as these."""
        return float(np.clip(self.finger_length - GRASPNET_BACK, *GRASPNET_DEPTHS))

    @property
    def base_to_contacts(self) -> float:
        """Distance from the mounting face, the gripper base, to the contact line, on approach."""
        return self.flange_to_tip - self.tip_reach

    def opening(self, width: ArrayLike) -> Array:
        """Return the distance between the open fingers for contacts `width` (...) apart."""
        return np.asarray(width, np.float64) + 2.0 * self.clearance

    def swept(self, distance: float) -> "Gripper":
        """Return a gripper that fills the space swept on the last `distance` metres.

        The gripper moves along its approach axis, open. Its palm is as wide as the open fingers, or
        is made so, so that a longer palm also covers the space that the fingers sweep.
        """
        return _swept(self, distance)

    def bounds(self, width: ArrayLike) -> Array:
        """Return the bounds (..., 9) of the bodies in metres; the gripper is mirror symmetric.

        In order: the fingers' back and tip along approach, the palm's back and front, half the
        fingers' and the palm's height, the inner and outer face of a finger and the side of the
        palm along closing. `width` (...) is the distance of the contacts; in the grasp frame, the
        contact line is at approach = 0, binormal = 0.
        """
        inner = self.opening(width) / 2.0
        tip, back = self.tip_reach, self.tip_reach - self.finger_length
        bounds = np.empty((*inner.shape, 9))
        bounds[..., :4] = back, tip, back - self.palm_depth, back
        bounds[..., 4:6] = self.finger_height / 2, self.palm_height / 2
        bounds[..., 6], bounds[..., 7] = inner, inner + self.finger_thickness
        # The palm is at least as wide as the open fingers, which are mounted on the palm.
        bounds[..., 8] = np.maximum(self.palm_width / 2, bounds[..., 7])
        return bounds

    def boxes(self, width: ArrayLike) -> Array:
        """Return the low and high corners (..., 3, 2, 3) of both fingers and the palm."""
        bounds = np.moveaxis(self.bounds(width), -1, 0)
        back, tip, palm_back, front, half, palm_half, inner, outer, side = bounds
        boxes = np.empty((*inner.shape, 3, 2, 3))
        boxes[..., :2, 0, 0], boxes[..., :2, 1, 0] = back[..., None], tip[..., None]
        boxes[..., 0, 0, 1], boxes[..., 0, 1, 1] = -outer, -inner
        boxes[..., 1, 0, 1], boxes[..., 1, 1, 1] = inner, outer
        boxes[..., :2, 0, 2], boxes[..., :2, 1, 2] = -half[..., None], half[..., None]
        boxes[..., 2, 0, 0], boxes[..., 2, 1, 0] = palm_back, front
        boxes[..., 2, 0, 1], boxes[..., 2, 1, 1] = -side, side
        boxes[..., 2, 0, 2], boxes[..., 2, 1, 2] = -palm_half, palm_half
        return boxes


@cache  # all regions of a run use the same few
def _swept(gripper: Gripper, distance: float) -> Gripper:
    swept = copy(gripper)  # not checked: a path may be longer than any gripper
    height = max(gripper.palm_height, gripper.finger_height)
    vars(swept).update(palm_depth=gripper.palm_depth + distance, palm_height=height)
    return swept
