"""One simulated trial of a grasp: approach, close, lift, five tugs. Table frame, metres."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array
from pipelines.configs import SimulateConfig
from pipelines.evaluation.runs.trial_records import HELD, Outcome
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.runtime.physics import mujoco
from pipelines.simulation.gripper_model import (
    FINGER_STIFFNESS,
    SimulatedGripper,
    add_gripper,
    stroke,
)
from pipelines.simulation.world import TIME_STEP, Pieces, add_object, empty_world
from pipelines.synthesis.scenes.settling import compiled_world

# Outcomes of a trial, in the order in which they can happen.
TRIAL_OUTCOMES = (
    "no grasp",
    "diverged",
    "collision",
    "not lifted",
    "dropped",
    "slipped",
    "turned",
    HELD,
)
# MuJoCo resets a scene that diverges; such a trial is invalid.
DIVERGED = [
    int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{state}")) for state in ("QPOS", "QVEL", "QACC")
]

GRAVITY = 9.81  # m / s^2
APPROACH_SECONDS, LIFT_SECONDS = 0.6, 0.75
REST_SECONDS = 0.1  # after each movement
CLOSING_SPEED = 0.1  # metres per second, of each finger
CLOSED_SPEED = 0.002  # metres per second; slower fingers are in contact
SQUEEZE_SECONDS = 0.1
TUG_SECONDS = 0.2
# Along the gripper's axes, except toward the palm.
TUGS = np.array([[1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float64)
START_DEPTH = 0.001  # metres by which the open gripper may intersect a body at the start


@dataclass(frozen=True)
class Trial:
    """A compiled scene with a gripper at a grasp, and the object to grasp."""

    model: mujoco.MjModel
    data: mujoco.MjData
    gripper: SimulatedGripper
    body: int
    stroke: float  # metres, of each finger until both meet
    config: SimulateConfig

    @classmethod
    def of(
        cls,
        objects: Mapping[int, Pieces],
        poses: Mapping[int, Array],
        target: int,
        grasp: GraspPoses,
        gripper: Gripper,
        config: SimulateConfig,
        surroundings: Pieces = (),
    ) -> "Trial":
        """Return the trial of one `grasp`, table frame, on the object `target`.

        `objects`: convex pieces, object frame; `poses`: (4, 4), object to table, at rest;
        `surroundings`: convex and immovable, table frame.
        """
        spec = empty_world(surroundings)
        # Objects at rest, most of a scene for most of the time, are not computed.
        spec.option.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
        add_gripper(spec, grasp, gripper)
        for object_id, pose in poses.items():
            add_object(spec, str(object_id), objects[object_id], pose)
        data = mujoco.MjData(model := compiled_world(spec))
        simulated = SimulatedGripper.of(model, data)
        body = model.body(str(target)).id
        return cls(model, data, simulated, body, stroke(grasp, gripper), config)

    def run(self, friction: float) -> Outcome:
        """Simulate one trial from the start, with `friction` between fingers and objects."""
        outcome = self._attempt(friction)
        diverged = any(self.data.warning[warning].number for warning in DIVERGED)
        return Outcome("diverged") if diverged else outcome

    def _attempt(self, friction: float) -> Outcome:
        mujoco.mj_resetData(self.model, self.data)
        self.gripper.set_friction(friction)
        self.gripper.limit_forces(self.config.arm_force, self.grip_force)
        if not self._approach():
            return Outcome("collision")
        height = self._height
        self._close()
        before = self._in_gripper()
        self._lift()
        if not self._is_raised(height):
            return Outcome("not lifted")
        if self._height - height > self._least_rise:
            self._tug()
        slip, turn = _change(before, self._in_gripper())
        return Outcome(self._verdict(height, slip, turn), slip, turn)

    @property
    def grip_force(self) -> float:
        """Force of each finger, newtons, proportional to the object's weight."""
        weight = GRAVITY * float(self.model.body_mass[self.body])
        return min(self.config.grip_force * weight, self.config.max_force)

    @property
    def _squeezed(self) -> float:
        """Target in metres from which the fingers press with `grip_force`, however thin the object.

        A finger's servo presses in proportion to the distance from its target.
        """
        return self.stroke + self.grip_force / FINGER_STIFFNESS

    def _approach(self) -> bool:
        """Move along the approach axis; return whether the path was free."""
        start = np.array([-self.config.approach, 0.0, 0.0])
        self.gripper.put(start)
        mujoco.mj_forward(self.model, self.data)
        if self.gripper.penetration() > START_DEPTH:
            return False
        for share in _smooth(APPROACH_SECONDS):
            self._step((1.0 - share) * start, 0.0)
            if self.gripper.arm_force > self.config.stop_force:
                return False
        return True

    def _close(self) -> None:
        """Close the fingers until contact, and squeeze."""
        travel, place = 0.0, np.zeros(3)
        while travel < self.stroke:
            travel += CLOSING_SPEED * TIME_STEP
            self._step(place, travel)
            moved = travel > CLOSING_SPEED * REST_SECONDS
            if moved and self.gripper.closing_speed < CLOSED_SPEED:
                break
        self._wait(place, SQUEEZE_SECONDS)

    def _lift(self) -> None:
        up = self.config.lift * self._to_gripper(np.array([0.0, 0.0, 1.0]))
        for share in _smooth(LIFT_SECONDS):
            self._step(share * up, self._squeezed)
        self._wait(up, REST_SECONDS)

    def _tug(self) -> None:
        """Pull at the object's centre of mass, as an arm's accelerations would."""
        place = self.gripper.target
        mass = float(self.model.body_mass[self.body])
        for direction in TUGS:
            force = self._gripper_rotation @ (mass * self.config.tug * direction)
            for share in _pulse():
                self.data.xfrc_applied[self.body, :3] = share * force
                self._step(place, self._squeezed)
            self.data.xfrc_applied[self.body] = 0.0
            self._wait(place, REST_SECONDS)

    @property
    def _least_rise(self) -> float:
        """Height in metres that an object rises at least unless it slips too far."""
        return self.config.lift - self.config.max_slip

    def _is_raised(self, height: float) -> bool:
        """Return whether the fingers hold the object half of the lift above `height` or more.

        Less is enough if `max_slip` allows more than half of the lift.
        """
        least = min(self.config.lift / 2.0, self._least_rise)
        return self._height - height > least and self.gripper.touches(self.body)

    def _verdict(self, height: float, slip: float, turn: float) -> str:
        if not self._is_raised(height):
            return "dropped"
        if slip >= self.config.max_slip or self._height - height <= self._least_rise:
            return "slipped"
        return "turned" if turn >= self.config.max_turn else HELD

    def _wait(self, place: Array, seconds: float) -> None:
        for _ in range(round(seconds / TIME_STEP)):
            self._step(place, self._squeezed)

    def _step(self, place: Array, travel: float) -> None:
        self.gripper.steer(place, travel)
        mujoco.mj_step(self.model, self.data)

    @property
    def _height(self) -> float:
        return float(self.data.xipos[self.body, 2])

    @property
    def _gripper_rotation(self) -> Array:
        return np.array(self.data.xmat[self.gripper.bodies[0]]).reshape(3, 3)

    def _to_gripper(self, vector: Array) -> Array:
        return np.asarray(self._gripper_rotation.T @ vector)

    def _in_gripper(self) -> tuple[Array, Array]:
        """Return the object's centre of mass (3,) and rotation (3, 3) in the gripper frame."""
        offset = self.data.xipos[self.body] - self.data.xpos[self.gripper.bodies[0]]
        rotation = np.array(self.data.xmat[self.body]).reshape(3, 3)
        return self._to_gripper(offset), self._gripper_rotation.T @ rotation


def _change(before: tuple[Array, Array], after: tuple[Array, Array]) -> tuple[float, float]:
    """Return the distance, metres, and angle, degrees, between two poses of an object."""
    cosine = (np.trace(before[1].T @ after[1]) - 1.0) / 2.0
    turn = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return float(np.linalg.norm(after[0] - before[0])), float(turn)


def _smooth(seconds: float) -> Iterator[float]:
    """Yield the completed share of a smooth movement, step by step."""
    steps = round(seconds / TIME_STEP)
    for u in np.arange(1, steps + 1) / steps:
        yield float(u**3 * (10.0 - 15.0 * u + 6.0 * u**2))


def _pulse() -> Iterator[float]:
    """Yield the strength of a pull, step by step, from 0 to 1 and back."""
    steps = round(TUG_SECONDS / TIME_STEP)
    for u in np.arange(1, steps + 1) / steps:
        yield float(np.sin(np.pi * u) ** 2)
