"""Objects on a table as a MuJoCo model, and their poses at rest; table frame, top at z = 0."""

from collections.abc import Mapping, Sequence

import numpy as np

from pipelines.array_types import Array
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import make_pose, matrix_to_quaternion, quaternion_to_matrix
from pipelines.runtime.physics import mujoco
from pipelines.synthesis.scenes.settling import DENSITY, FRICTION, add_convex, compiled_world

Pieces = Sequence[Mesh]

TIME_STEP = 0.001  # seconds
# The stiffest contacts that MuJoCo resolves have a time constant of two time steps.
STIFF = [2.0 * TIME_STEP, 1.0]
HARD = [0.95, 0.99, 0.001, 0.5, 2.0]
IMPRATIO = 20.0  # stiffness of contacts along over across the surface; held objects do not creep
# Collision bits: the parts of a gripper do not collide with each other.
GRIPPER_BIT, WORLD_BIT = 1, 2

REST_SECONDS = 1.0  # longest time until rest
REST_SPEED = 1e-3  # metres or radians per second; slower bodies are at rest
REST_DAMPING = 0.9  # share of its speed that a body keeps in each step, against bouncing
REST_CHECK = 20  # steps between checks for rest


def empty_world(surroundings: Pieces = ()) -> mujoco.MjSpec:
    """Return a table with no objects, but with convex and immovable `surroundings`."""
    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep = TIME_STEP
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = IMPRATIO
    table = spec.worldbody.add_geom(
        name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2.0, 2.0, 0.1]
    )
    _make_world(table)
    for number, piece in enumerate(surroundings):
        _make_world(add_convex(spec, spec.worldbody, f"surroundings{number}", piece))
    return spec


def add_object(spec: mujoco.MjSpec, name: str, pieces: Pieces, pose: Array) -> None:
    """Add an object of convex `pieces`, object frame, at `pose` (4, 4), object to table."""
    body = spec.worldbody.add_body(
        name=name, pos=pose[:3, 3].tolist(), quat=matrix_to_quaternion(pose[:3, :3]).tolist()
    )
    body.add_freejoint(name=name)
    for number, piece in enumerate(pieces):
        geom = add_convex(spec, body, f"{name}_{number}", piece)
        geom.density = DENSITY
        _make_world(geom)


def object_pose(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> Array:
    """Return the pose (4, 4) of an object, object to table."""
    body = model.body(name).id
    start = model.jnt_qposadr[model.body_jntadr[body]]
    place = data.qpos[start : start + 7]
    return make_pose(quaternion_to_matrix(place[3:]), place[:3])


def at_rest(
    objects: Mapping[int, Pieces], poses: Mapping[int, Array], surroundings: Pieces = ()
) -> dict[int, Array]:
    """Return the poses (4, 4), object to table, at rest, of objects that start at `poses`.

    Poses of a dataset are rounded or measured: objects float a little or overlap. Strong damping
    lets the objects settle without being flung away.
    """
    if not poses:
        return {}
    spec = empty_world(surroundings)
    for object_id, pose in poses.items():
        add_object(spec, str(object_id), objects[object_id], pose)
    data = mujoco.MjData(model := compiled_world(spec))
    for step in range(int(REST_SECONDS / TIME_STEP)):
        mujoco.mj_step(model, data)
        data.qvel *= REST_DAMPING
        if step % REST_CHECK == REST_CHECK - 1 and np.abs(data.qvel).max() < REST_SPEED:
            break
    return {object_id: object_pose(model, data, str(object_id)) for object_id in poses}


def _make_world(geom: mujoco.MjsGeom) -> None:
    geom.friction, geom.condim = FRICTION, 6
    geom.solref, geom.solimp = STIFF, HARD
    geom.contype, geom.conaffinity = WORLD_BIT, WORLD_BIT | GRIPPER_BIT
