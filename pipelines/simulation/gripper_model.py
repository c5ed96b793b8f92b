"""A force-limited parallel gripper made of a preset's boxes, in a MuJoCo model.

The gripper has the grasp frame: approach, closing, binormal. The palm slides along the three axes
without turning, as on an arm much stronger than the load; the fingers move symmetrically.
"""

from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices
from pipelines.geometry.transforms import matrix_to_quaternion
from pipelines.grasping.grasps import GraspPoses
from pipelines.grasping.gripper import Gripper
from pipelines.runtime.physics import mujoco
from pipelines.simulation.world import GRIPPER_BIT, HARD, STIFF, WORLD_BIT

PALM_MASS, FINGER_MASS = 1.0, 0.1  # kg
# N / m and N s / m; no less than the critical damping, 310 and 28 N s / m.
ARM_STIFFNESS, ARM_DAMPING = 2.0e4, 400.0
FINGER_STIFFNESS, FINGER_DAMPING = 2.0e3, 30.0
PAD_RADIUS = 0.008  # metres, of the contact patch of a soft finger pad
JOINT_SLACK = 0.001  # metres by which a finger can move beyond its open position
FINGERS = ("finger0", "finger1")  # the first is at -closing
SLIDES = ("slide0", "slide1", "slide2")


def add_gripper(spec: mujoco.MjSpec, grasp: GraspPoses, gripper: Gripper) -> None:
    """Add the gripper at one `grasp`, table frame, opened for the width, up to the limit."""
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
    coupling.data[:5] = [0.0, 1.0, 0.0, 0.0, 0.0]  # one joint as a polynomial of the other


def opened_for(grasp: GraspPoses, gripper: Gripper) -> float:
    """Return the distance of contacts that the gripper opens for, metres."""
    return min(float(grasp.width[0]), gripper.max_width)


def stroke(grasp: GraspPoses, gripper: Gripper) -> float:
    """Return the distance by which each finger can close until both meet, metres."""
    return float(gripper.opening(opened_for(grasp, gripper))) / 2.0


@dataclass(frozen=True)
class SimulatedGripper:
    """The gripper of a compiled model, with the indices of its parts in MuJoCo's arrays."""

    model: mujoco.MjModel
    data: mujoco.MjData
    slides: Indices  # of the palm in qpos
    velocities: Indices  # of the fingers in qvel
    arm: Indices  # in ctrl
    grip: Indices  # of the fingers in ctrl
    finger_bodies: Indices
    bodies: Indices

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData) -> "SimulatedGripper":
        """Return the gripper that `add_gripper` put into the model."""
        fingers = [model.joint(name).id for name in FINGERS]
        finger_bodies = np.array([model.body(name).id for name in FINGERS])
        return cls(
            model,
            data,
            model.jnt_qposadr[[model.joint(name).id for name in SLIDES]],
            model.jnt_dofadr[fingers],
            np.array([model.actuator(name).id for name in SLIDES]),
            np.array([model.actuator(name).id for name in FINGERS]),
            finger_bodies,
            np.array([model.body("palm").id, *finger_bodies]),
        )

    def set_friction(self, friction: float) -> None:
        """Set the friction of all contacts of the gripper.

        A soft pad also resists turning about the contact's normal, like a disc of `PAD_RADIUS`.
        """
        geoms = np.isin(self.model.geom_bodyid, self.bodies)
        self.model.geom_friction[geoms] = [friction, 2.0 / 3.0 * friction * PAD_RADIUS, 0.0]

    def limit_forces(self, arm: float, fingers: float) -> None:
        """Limit the force of the arm and that of each finger, newtons."""
        self.model.actuator_forcerange[self.arm] = [-arm, arm]
        self.model.actuator_forcerange[self.grip] = [-fingers, fingers]

    def put(self, place: Array) -> None:
        """Place the open gripper at `place` (3,), metres from the grasp, gripper axes."""
        self.data.qpos[self.slides] = place
        self.steer(place, 0.0)

    def steer(self, place: Array, travel: float) -> None:
        """Set the targets of the servos: the palm at `place` (3,), each finger at `travel`."""
        self.data.ctrl[self.arm] = place
        self.data.ctrl[self.grip] = travel

    @property
    def target(self) -> Array:
        """Target (3,) of the arm's servos, metres from the grasp, gripper axes."""
        return np.array(self.data.ctrl[self.arm])

    @property
    def arm_force(self) -> float:
        """Force of the arm, newtons."""
        return float(np.linalg.norm(self.data.actuator_force[self.arm]))

    @property
    def closing_speed(self) -> float:
        """Closing speed of the faster finger, metres per second."""
        return float(np.abs(self.data.qvel[self.velocities]).max())

    def touches(self, body: int) -> bool:
        """Return whether both fingers touch `body`."""
        pairs = self._pairs()
        return all(
            (((pairs == finger).any(axis=1)) & ((pairs == body).any(axis=1))).any()
            for finger in self.finger_bodies
        )

    def penetration(self) -> float:
        """Return the largest depth of the gripper in another body, metres."""
        of_gripper = np.isin(self._pairs(), self.bodies).any(axis=1)
        depth = -self.data.contact.dist[of_gripper]
        return float(depth.max(initial=0.0))

    def _pairs(self) -> Indices:
        """Return the pairs of bodies in contact (contacts, 2)."""
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
        forcerange=[-1.0, 1.0],  # replaced by `limit_forces`
    )


def _box(body: mujoco.MjsBody, corners: Array, mass: float) -> None:
    low, high = corners
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=((low + high) / 2.0).tolist(),
        size=((high - low) / 2.0).tolist(),
        mass=mass,
        condim=4,
        priority=1,  # contacts have the gripper's parameters
        solref=STIFF,
        solimp=HARD,
        contype=GRIPPER_BIT,
        conaffinity=WORLD_BIT,
    )
