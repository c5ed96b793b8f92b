"""Objects dropped onto a table and settled by physics (MuJoCo). The table's top is z = 0, z up."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.array_types import Array, Indices
from pipelines.errors import SymgraspError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import make_pose, quaternion_to_matrix
from pipelines.runtime.physics import mujoco
from pipelines.synthesis.scenes.surroundings import Container

TABLE_RADIUS = 0.30  # metres from the middle; objects that roll farther are removed
DROP_RADIUS = (0.05, 0.15)  # metres, drawn for each scene: from piled to scattered objects
SETTLE_SECONDS = 3.0
SETTLE_STEP = 0.003  # seconds
DENSITY = 400.0  # kg / m^3, a half-full household object
FRICTION = [0.9, 0.02, 0.005]  # of objects with the table and each other
FOUNDATION = 0.1  # metres below the table to which the floor of a container reaches for a drop
ROOM, GAP = 0.6, 0.02  # between dropped objects: of the radius of the upper one; metres
UPRIGHT = 0.5  # share of the objects that are dropped upright, as people place them
DAMPING = 2e-4  # of all motions, N s / m and N m s
LOWEST = -0.02  # metres; the middle of an object that fell off the table is below
MAX_SPEED = 0.15  # metres or radians per second of a settled object


@dataclass(frozen=True)
class SettledScene:
    """Poses at which dropped objects came to rest."""

    index: Indices  # (k,) indices of the dropped objects that stayed on the table, ascending
    poses: Array  # (k, 4, 4) object to table


def drop_objects(
    pieces: Sequence[Sequence[Mesh]],
    rng: np.random.Generator,
    centers: Array | None = None,
    container: Container | None = None,
) -> SettledScene:
    """Drop objects, each given as convex `pieces` in its own frame, one above the other.

    `centers`: (k, 3) metres, middle of each object in its frame, for placing and removing objects,
    since an origin may be far from its object; None: the origins. `container`: the objects fall
    into the container, and objects at rest outside are removed.

    Raises:
        SymgraspError: MuJoCo cannot make bodies from the pieces.
    """
    middles = np.zeros((len(pieces), 3)) if centers is None else np.asarray(centers, np.float64)
    fixed = (_founded(container.solids[0]), *container.solids[1:]) if container else ()
    data = mujoco.MjData(model := _model_of(pieces, fixed))
    height, spread = container.floor if container else 0.0, rng.uniform(*DROP_RADIUS)
    for body, parts in enumerate(pieces):
        spokes = (part.vertices - middles[body] for part in parts)
        radius = max(float(np.linalg.norm(spoke, axis=1).max()) for spoke in spokes)
        at = container.place(radius, rng) if container else _place(spread, rng)
        height += ROOM * radius + GAP
        place = [*at, height + radius]
        turn = _drawn_orientation(rng)
        origin = np.array(place) - quaternion_to_matrix(turn) @ middles[body]
        data.qpos[7 * body : 7 * body + 7] = [*origin, *turn]
    for _ in range(int(SETTLE_SECONDS / SETTLE_STEP)):
        mujoco.mj_step(model, data)
    places = data.qpos.reshape(-1, 7)
    poses = make_pose(quaternion_to_matrix(places[:, 3:]), places[:, :3])
    rest = middles_of(poses, middles)
    speed = np.abs(data.qvel.reshape(-1, 6)).max(axis=1)
    on_table = (np.linalg.norm(rest[:, :2], axis=1) < TABLE_RADIUS) & (rest[:, 2] > LOWEST)
    kept = container.holds(rest) if container else on_table
    index = np.flatnonzero(kept & (speed < MAX_SPEED))
    return SettledScene(index, poses[index])


def _place(spread: float, rng: np.random.Generator) -> list[float]:
    angle, distance = rng.uniform(0, 2 * np.pi), spread * np.sqrt(rng.uniform())
    return [distance * np.cos(angle), distance * np.sin(angle)]


def middles_of(poses: Array, centers: Array) -> Array:
    """Return `centers` (k, 3), object frames, moved by `poses` (k, 4, 4): (k, 3) metres."""
    turned = np.einsum("kij,kj->ki", poses[:, :3, :3], centers)
    return np.asarray(poses[:, :3, 3] + turned)


def refuse_bodiless(pieces: Sequence[Mesh]) -> None:
    """Raise SymgraspError if MuJoCo cannot make a body from the convex `pieces` of an object."""
    _model_of([pieces])


def compiled_world(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the compiled model of a world.

    Raises:
        SymgraspError: MuJoCo cannot make bodies from the objects' pieces.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise SymgraspError(
            f"convex pieces of a model make no solid body ({' '.join(str(error).split())}); mend "
            "its mesh or, if it came out too small, its --mesh-scale, and delete its convex.npz"
        ) from error


def _drawn_orientation(rng: np.random.Generator) -> Array:
    """Return a random quaternion, w first, in a share `UPRIGHT` of the draws about z alone."""
    if rng.uniform() < UPRIGHT:
        half = rng.uniform(0, np.pi)
        return np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
    return rng.normal(size=4)


def add_convex(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, piece: Mesh) -> mujoco.MjsGeom:
    """Add a convex piece to `body` under the unique `name` in the model; return its geom."""
    spec.add_mesh(
        name=name,
        uservert=piece.vertices.ravel().tolist(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX,
    )
    return body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)


def _founded(plate: Mesh) -> Mesh:
    """Return the level `plate` on the table, its underside moved to `FOUNDATION` below the table.

    A thin plate does not hold: what falls past its middle is pushed out below.
    """
    vertices = plate.vertices.copy()
    vertices[vertices[:, 2] < plate.bounds[:, 2].mean(), 2] = -FOUNDATION
    return Mesh(vertices, plate.faces)


def _model_of(pieces: Sequence[Sequence[Mesh]], fixed: Sequence[Mesh] = ()) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    spec.option.timestep = SETTLE_STEP
    ground = [spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2, 2, 0.1])]
    ground += [
        add_convex(spec, spec.worldbody, f"fixed{number}", piece)
        for number, piece in enumerate(fixed)
    ]
    for geom in ground:
        geom.friction, geom.condim = FRICTION, 6
    for number, parts in enumerate(pieces):
        body = spec.worldbody.add_body(name=f"object{number}")
        # Damping replaces the rolling friction that stiff contacts lack: balls come to rest.
        body.add_freejoint()
        for part_number, part in enumerate(parts):
            geom = add_convex(spec, body, f"mesh{number}_{part_number}", part)
            geom.density, geom.friction, geom.condim = DENSITY, FRICTION, 6
    model = compiled_world(spec)
    model.dof_damping[:] = DAMPING
    return model
