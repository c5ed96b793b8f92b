"""A force-limited parallel gripper with a preset's boxes, as bodies of a MuJoCo model.

The hand's frame is the grasp's: approach, closing, approach x closing. It slides along the three
axes and never turns, as an arm that is much stronger than what it holds; the fingers slide towards
each other by equal ways, as in every parallel gripper.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from pipelines.array_types import Array, Indices
from pipelines.geometry.transforms import matrix_to_quaternion
from pipelines.grasping.grasps import Grasps
from pipelines.grasping.gripper import Gripper
from pipelines.simulation.world import HAND, HARD, STIFF, WORLD

PALM_MASS, FINGER_MASS = 1.0, 0.1  # kg
ARM_STIFFNESS, ARM_DAMPING = 2.0e4, 400.0  # N / m, N s / m: critical for the palm
FINGER_STIFFNESS, FINGER_DAMPING = 2.0e3, 30.0
PAD_RADIUS = 0.008  # metres, of the patch in which a soft finger pad touches
JOINT_SLACK = 0.001  # metres that a finger can open beyond its open position
FINGERS = ("finger0", "finger1")  # the first starts at -closing
SLIDES = ("slide0", "slide1", "slide2")


def add_hand(spec: mujoco.MjSpec, grasp: Grasps, gripper: Gripper) -> None:
    """Add the hand at one `grasp`, table frame, open as far as that grasp asks and it can."""
    boxes = gripper.boxes(opened_for(grasp, gripper))
    palm = spec.worldbody.add_body(
        name="palm",
        pos=grasp.translation[0].tolist(),
        quat=matrix_to_quaternion(grasp.rotation[0]).tolist(),
        gravcomp=1.0,
    )
    for name, axis in zip(SLIDES, np.eye(3).tolist(), strict=True):
        palm.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        _servo(spec, name, ARM_STIFFNESS, ARM_DAMPING)
    _box(palm, boxes[2], PALM_MASS)
    for name, box, sign in zip(FINGERS, boxes[:2], (1.0, -1.0), strict=True):
        finger = palm.add_body(name=name, gravcomp=1.0)
        finger.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[0.0, sign, 0.0],
            range=[-JOINT_SLACK, stroke(grasp, gripper)],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        )
        _servo(spec, name, FINGER_STIFFNESS, FINGER_DAMPING)
        _box(finger, box, FINGER_MASS)
    coupling = spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=FINGERS[0],
        name2=FINGERS[1],
        solref=STIFF,
        solimp=HARD,
    )
    coupling.data[:5] = [0.0, 1.0, 0.0, 0.0, 0.0]  # the one joint as a polynomial of the other


def opened_for(grasp: Grasps, gripper: Gripper) -> float:
    """Return the distance of contacts, metres, that the hand opens for."""
    return min(float(grasp.width[0]), gripper.max_width)


def stroke(grasp: Grasps, gripper: Gripper) -> float:
    """Return how far each finger can close, metres: until they meet."""
    return float(gripper.opening(opened_for(grasp, gripper))) / 2.0


@dataclass(frozen=True)
class Hand:
    """The hand of a compiled model; where its parts are in MuJoCo's arrays."""

    model: mujoco.MjModel
    data: mujoco.MjData
    slides: Indices  # in qpos, of the palm
    fingers: Indices  # in qpos
    velocities: Indices  # in qvel, of the fingers
    arm: Indices  # in ctrl
    grip: Indices  # in ctrl
    finger_bodies: Indices
    bodies: Indices

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData) -> "Hand":
        """Return the hand that `add_hand` put into the model."""
        fingers = [model.joint(name).id for name in FINGERS]
        finger_bodies = np.array([model.body(name).id for name in FINGERS])
        return cls(
            model,
            data,
            model.jnt_qposadr[[model.joint(name).id for name in SLIDES]],
            model.jnt_qposadr[fingers],
            model.jnt_dofadr[fingers],
            np.array([model.actuator(name).id for name in SLIDES]),
            np.array([model.actuator(name).id for name in FINGERS]),
            finger_bodies,
            np.array([model.body("palm").id, *finger_bodies]),
        )

    def set_friction(self, friction: float) -> None:
        """Let everything that the hand touches rub with `friction`.

        A soft pad also resists turning about the contact's normal, as a disc of `PAD_RADIUS`.
        """
        geoms = np.isin(self.model.geom_bodyid, self.bodies)
        self.model.geom_friction[geoms] = [friction, 2.0 / 3.0 * friction * PAD_RADIUS, 0.0]

    def limit_forces(self, arm: float, fingers: float) -> None:
        """Let the arm push with at most `arm`, each finger with at most `fingers` newtons."""
        self.model.actuator_forcerange[self.arm] = [-arm, arm]
        self.model.actuator_forcerange[self.grip] = [-fingers, fingers]

    def put(self, place: Array) -> None:
        """Put the open hand at `place` (3,), metres from the grasp, hand's axes."""
        self.data.qpos[self.slides] = place
        self.steer(place, 0.0)

    def steer(self, place: Array, travel: float) -> None:
        """Set where the servos pull: the hand to `place` (3,), each finger to `travel`."""
        self.data.ctrl[self.arm] = place
        self.data.ctrl[self.grip] = travel

    @property
    def target(self) -> Array:
        """(3,) where the arm pulls the hand to, metres from the grasp, hand's axes."""
        return np.array(self.data.ctrl[self.arm])

    @property
    def arm_force(self) -> float:
        """Newtons that the arm pushes with."""
        return float(np.linalg.norm(self.data.actuator_force[self.arm]))

    @property
    def closing_speed(self) -> float:
        """Metres a second at which the faster finger closes."""
        return float(np.abs(self.data.qvel[self.velocities]).max())

    def touches(self, body: int) -> bool:
        """Return whether both fingers touch `body`."""
        pairs = self._pairs()
        return all(
            (((pairs == finger).any(axis=1)) & ((pairs == body).any(axis=1))).any()
            for finger in self.finger_bodies
        )

    def penetration(self) -> float:
        """Return how deep the hand is in anything, metres."""
        with_hand = np.isin(self._pairs(), self.bodies).any(axis=1)
        depth = -self.data.contact.dist[with_hand]
        return float(depth.max(initial=0.0))

    def _pairs(self) -> Indices:
        """Return (contacts, 2) the bodies that touch."""
        return np.asarray(self.model.geom_bodyid[self.data.contact.geom]).reshape(-1, 2)


def _servo(spec: mujoco.MjSpec, joint: str, stiffness: float, damping: float) -> None:
    spec.add_actuator(
        name=joint,
        target=joint,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        gainprm=[stiffness] + [0.0] * 9,
        biasprm=[0.0, -stiffness, -damping] + [0.0] * 7,
        forcelimited=mujoco.mjtLimited.mjLIMITED_TRUE,
        forcerange=[-1.0, 1.0],  # until `limit_forces` says
    )


def _box(body: mujoco.MjsBody, corners: Array, mass: float) -> None:
    low, high = corners
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=((low + high) / 2.0).tolist(),
        size=((high - low) / 2.0).tolist(),
        mass=mass,
        condim=4,
        priority=1,  # what a contact is like is the hand's affair
        solref=STIFF,
        solimp=HARD,
        contype=HAND,
        conaffinity=WORLD,
    )
