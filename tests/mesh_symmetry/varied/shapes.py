"""Constructed household objects, with the symmetries that they are meant to have.

Upright along z, metres. Bodies of revolution have defects too small to be another shape; the other
objects break a symmetry by at least 4 % of their size, or by a separate part.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import trimesh

from pipelines.array_types import Array
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import rotation_about
from pipelines.mesh_symmetry.surface.sampled_surface import Surface
from tests.mesh_symmetry.varied import defects

AROUND = 120  # vertices of a circle
ALONG = 0.004  # metres between the circles
X, Y, Z = np.eye(3)
Plane = tuple[Array, Array]  # normal and point


@dataclass(frozen=True)
class Varied:
    """An object with its true symmetries; planes that contain the axis are true as well.

    `planes` must be found, or three of them; `unclear` ones may be found. Holes stay away from
    `feature`, which breaks symmetries of the rest, and from its `images` under these symmetries.
    """

    mesh: Mesh
    axis: tuple[Array, Array] | None = None  # direction and point
    planes: tuple[Plane, ...] = ()
    unclear: tuple[Plane, ...] = ()
    feature: Array | None = None
    images: tuple[Array, ...] = ()


Profile = Callable[[np.random.Generator], list[tuple[float, float]]]
Draw = Callable[[np.random.Generator], Varied]


def turned(profile: Sequence[tuple[float, float]]) -> trimesh.Trimesh:
    """Return the surface that a line of (radius, height) sweeps about z."""
    corners = np.asarray(profile, float)
    pieces = []
    for start, end in pairwise(corners):
        count = max(1, int(np.ceil(np.linalg.norm(end - start) / ALONG)))
        pieces.append(start + (end - start) * (np.arange(count) / count)[:, None])
    line = np.concatenate([*pieces, corners[-1:]])
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    x, y = np.outer(line[:, 0], np.cos(angle)), np.outer(line[:, 0], np.sin(angle))
    points = np.stack([x, y, np.broadcast_to(line[:, 1:], x.shape)], axis=-1).reshape(-1, 3)
    rows = AROUND * np.arange(len(line) - 1)[:, None]
    here, beside = np.arange(AROUND), np.roll(np.arange(AROUND), -1)
    a, b, c, d = (rows + k for k in (here, beside, here + AROUND, beside + AROUND))
    faces = np.concatenate([np.stack([a, b, d], -1), np.stack([a, d, c], -1)]).reshape(-1, 3)
    made = trimesh.Trimesh(points, faces, process=False)
    made.merge_vertices()
    made.update_faces(made.nondegenerate_faces())
    made.remove_unreferenced_vertices()
    return made


def _rounded(profile: Sequence[tuple[float, float]], rounds: int = 2) -> list[tuple[float, float]]:
    """Return the line with its corners cut, its ends kept (Chaikin)."""
    line = np.asarray(profile, float)
    for _ in range(rounds):
        a, b = line[:-1], line[1:]
        cut = np.stack([0.75 * a + 0.25 * b, 0.25 * a + 0.75 * b], axis=1).reshape(-1, 2)
        line = np.concatenate([line[:1], cut, line[-1:]])
    return [(float(r), float(z)) for r, z in line]


def can(rng):
    r, h = rng.uniform(0.025, 0.045), rng.uniform(0.08, 0.13)
    k = 0.0025
    return [
        (0, k), (r - k, k), (r - k, 0), (r, 0), (r, 2 * k), (r - k / 2, 3 * k),
        (r - k / 2, h - 3 * k), (r, h - 2 * k), (r, h), (r - k, h), (r - k, h - k), (0, h - k),
    ]  # fmt: skip


def bottle(rng):
    r, h = rng.uniform(0.025, 0.04), rng.uniform(0.15, 0.22)
    n = r * rng.uniform(0.3, 0.5)
    return _rounded([(0, 0), (r, 0), (r, 0.6 * h), (n, 0.75 * h), (n, h), (0, h)])


def bowl(rng):
    r, h, t = rng.uniform(0.06, 0.09), rng.uniform(0.04, 0.07), 0.004
    return _rounded([
        (0, 0), (0.45 * r, 0), (0.45 * r, 0.004), (0.9 * r, 0.5 * h), (r, h), (r - t, h),
        (0.9 * r - t, 0.5 * h + t), (0.4 * r, 0.004 + t), (0, 0.004 + t),
    ], 1)  # fmt: skip


def plate(rng):
    r, h, t = rng.uniform(0.08, 0.13), rng.uniform(0.012, 0.025), 0.004
    return [(0, 0), (0.6 * r, 0), (r, h), (r, h + t), (0.6 * r, t), (0, t)]


def cup(rng):
    r, h, t = rng.uniform(0.03, 0.045), rng.uniform(0.08, 0.12), 0.0025
    b = r * rng.uniform(0.65, 0.85)
    return [(0, 0), (b, 0), (r, h), (r + t, h), (r + t, h + t), (r - t, h + t), (b - t, t), (0, t)]


def marker(rng):
    r, h = rng.uniform(0.007, 0.011), rng.uniform(0.11, 0.14)
    c, n = r * rng.uniform(1.12, 1.3), r * rng.uniform(0.5, 0.75)
    return [
        (0, 0), (n, 0), (n, 0.08 * h), (r, 0.1 * h), (r, 0.6 * h), (c, 0.6 * h), (c, 0.95 * h),
        (0.8 * c, h), (0, h),
    ]  # fmt: skip


def pen(rng):
    r, h = rng.uniform(0.004, 0.006), rng.uniform(0.13, 0.17)
    return [(0, 0), (r / 3, 0), (r, 0.12 * h), (r, 0.97 * h), (0.7 * r, h), (0, h)]


def apple(rng):
    r = rng.uniform(0.032, 0.042)
    return _rounded([
        (0, 0.2 * r), (0.35 * r, 0), (0.8 * r, 0.3 * r), (1.08 * r, 1.2 * r),
        (0.75 * r, 1.9 * r), (0.25 * r, 1.85 * r), (0, 1.5 * r),
    ])  # fmt: skip


def lemon(rng):
    r, h = rng.uniform(0.026, 0.032), rng.uniform(0.078, 0.095)
    return _rounded([
        (0, 0), (0.25 * r, 0.05 * h), (0.4 * r, 0.12 * h), (1.05 * r, 0.35 * h),
        (1.05 * r, 0.65 * h), (0.35 * r, 0.9 * h), (0.2 * r, 0.97 * h), (0, h),
    ])  # fmt: skip


def jar(rng):
    r, h = rng.uniform(0.03, 0.045), rng.uniform(0.08, 0.12)
    lid = r * rng.uniform(0.82, 0.92)
    return [
        (0, 0), (0.9 * r, 0), (r, 0.08 * h), (r, 0.7 * h), (0.75 * r, 0.78 * h),
        (0.75 * r, 0.8 * h), (lid, 0.8 * h), (lid, h), (0, h),
    ]  # fmt: skip


def vase(rng):
    r, h, t = rng.uniform(0.035, 0.05), rng.uniform(0.14, 0.2), 0.003
    n = r * rng.uniform(0.4, 0.6)
    return _rounded([
        (0, 0), (0.6 * r, 0), (r, 0.35 * h), (n, 0.75 * h), (0.8 * r, h), (0.8 * r - t, h),
        (n - t, 0.75 * h), (r - t, 0.35 * h), (0.55 * r, t), (0, t),
    ], 2)  # fmt: skip


def roll(rng):
    r, h = rng.uniform(0.03, 0.05), rng.uniform(0.05, 0.1)
    n = r * rng.uniform(0.4, 0.8)
    return [(n, 0), (r, 0), (r, h), (n, h), (n, 0)]


def ring(rng):
    r, t = rng.uniform(0.035, 0.06), rng.uniform(0.008, 0.014)
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    return [(r + t * np.cos(a), t * np.sin(a)) for a in angle]


def funnel(rng):
    r, h, t = rng.uniform(0.04, 0.06), rng.uniform(0.08, 0.12), 0.002
    return [(0.006, 0), (0.008, 0.35 * h), (r, h), (r + t, h), (0.01, 0.34 * h), (0.008, 0)]


def handle(rng):
    r, h = rng.uniform(0.013, 0.018), rng.uniform(0.09, 0.12)
    return _rounded([
        (0, 0), (0.8 * r, 0), (r, 0.1 * h), (r, 0.7 * h), (0.7 * r, 0.8 * h), (0.9 * r, 0.95 * h),
        (0.3 * r, h), (0.2 * r, h), (0.2 * r, 1.6 * h), (0, 1.6 * h),
    ], 1)  # fmt: skip


def goblet(rng):
    r, h, t = rng.uniform(0.03, 0.04), rng.uniform(0.14, 0.19), 0.003
    return [
        (0, 0), (r, 0), (r, t), (0.005, 3 * t), (0.005, 0.5 * h), (0.9 * r, 0.65 * h), (r, h),
        (r - t, h), (0.9 * r - t, 0.66 * h), (0.004, 0.53 * h), (0, 0.53 * h),
    ]  # fmt: skip


def bulb(rng):
    r, h = rng.uniform(0.028, 0.034), rng.uniform(0.09, 0.11)
    base = 0.013
    return _rounded([
        (0, 0), (0.5 * base, 0), (base, 0.04 * h), (base, 0.27 * h), (1.3 * base, 0.35 * h),
        (r, 0.6 * h), (r, 0.82 * h), (0.6 * r, h), (0, h),
    ])  # fmt: skip


BODIES = (
    *(can, bottle, bowl, plate, cup, marker, pen, apple, lemon, jar, vase, roll, ring),
    *(funnel, handle, goblet, bulb),
)
UNCLEAR = ("can", "roll", "ring", "pen", "lemon", "apple")  # bodies whose two ends are nearly alike
SOFT = ("apple", "lemon")
LIMITS = np.array([0.0058, 0.015, 0.025])  # shares of the diagonal; the misses of a scanned apple
NUM_FITS = 5  # of the strength of defects
SLIM = 1.5  # height over width above which bodies are bent rather than fluted
MAX_STRENGTH = 2.0
WIDE = 0.4  # width over diagonal; defects of narrower bodies are smaller, as their width is
TURNS = np.radians([60.0, 90.0, 180.0])


def body(draw: Profile, rng: np.random.Generator) -> Varied:
    """Return a body of revolution with two or three defects that still looks round.

    The defects are as strong as in scans: from a third of the misses of a scanned apple to all.
    """
    plain, moved = _spoiled(draw, rng)
    wanted, strength = rng.uniform(0.33, 1.0), 1.0
    for _ in range(NUM_FITS):
        points = plain.vertices + strength * (moved - plain.vertices)
        mesh = Mesh(points, plain.faces)
        worst = max(np.array(misses(mesh)) / LIMITS)
        strength = min(MAX_STRENGTH, strength * wanted / worst)
    across = ((Z, np.zeros(3)),)
    unclear = across if draw.__name__ in UNCLEAR else ()
    return Varied(mesh, axis=(Z, np.zeros(3)), unclear=unclear)


def misses(mesh: Mesh) -> tuple[float, float, float]:
    """Return mean, 95th and 99th percentile of misses of turns about z, shares of the diagonal."""
    surface = Surface.from_mesh(mesh, 20_000, np.random.default_rng(0))
    worst = np.zeros(3)
    for angle in TURNS:
        image = surface.points[:3000] @ rotation_about(Z, angle).T
        gap = surface.distances(image)[0]
        worst = np.maximum(worst, [gap.mean(), *np.percentile(gap, [95.0, 99.0])])
    mean, p95, p99 = worst / defects.size_of(mesh.vertices)
    return float(mean), float(p95), float(p99)


def _spoiled(draw: Profile, rng: np.random.Generator) -> tuple[Mesh, Array]:
    """Return a body, and its vertices with two or three suitable defects."""
    made = turned(draw(rng))
    name = draw.__name__
    plain = np.asarray(made.vertices)
    plain = plain - (plain.min(axis=0) + plain.max(axis=0)) / 2.0 * Z
    points, turn = plain, rng.uniform(0.0, 2.0 * np.pi)
    if name in SOFT:
        points = defects.lumpy(points, 0.005, rng)
    height, width = np.ptp(points[:, 2]), np.ptp(points[:, 0])
    scale = min(1.0, width / defects.size_of(points) / WIDE)
    kinds: dict[str, Callable[[Array], Array]] = {
        "oval": lambda p: defects.oval(p, 0.007, turn),
        "dented": lambda p: defects.dented(p, 0.02 * scale, rng),
        "engraved": lambda p: defects.engraved(p, 0.005 * scale, rng),
        "sewn": lambda p: defects.sewn(p, 0.006 * scale),
        "lipped": lambda p: defects.lipped(p, 0.006 * scale, rng),
        "rough": lambda p: defects.rough(p, 0.003 * scale, rng),
    }
    if height > SLIM * width:
        kinds["bent"] = lambda p: defects.bent(p, 0.008, turn)
    else:
        kinds["fluted"] = lambda p: defects.fluted(p, 0.003, int(rng.integers(14, 30)))
    for kind in sorted(rng.choice(sorted(kinds), size=int(rng.integers(1, 4)), replace=False)):
        points = kinds[kind](points)
    return Mesh(plain, np.asarray(made.faces)), points


def _joined(*parts: trimesh.Trimesh) -> Mesh:
    made = trimesh.util.concatenate(parts)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def _box(x: float, y: float, z: float, at: Sequence[float] = (0, 0, 0)) -> trimesh.Trimesh:
    made = trimesh.creation.box((x, y, z))
    vertices, faces = trimesh.remesh.subdivide_to_size(made.vertices, made.faces, 0.006)
    fine = trimesh.Trimesh(vertices, faces, process=False)
    fine.merge_vertices()
    fine.apply_translation(at)
    return fine


def _through(*normals: Array) -> tuple[Plane, ...]:
    return tuple((normal, np.zeros(3)) for normal in normals)


def tray_of_parts(rng):
    """An open box with small objects in it: the box has two planes, the whole none."""
    x, y, z, t = rng.uniform(0.1, 0.14), rng.uniform(0.07, 0.09), rng.uniform(0.03, 0.05), 0.003
    walls = [
        _box(x, y, t),
        *(_box(t, y, z, (s * x / 2, 0, z / 2)) for s in (-1, 1)),
        *(_box(x, t, z, (0, s * y / 2, z / 2)) for s in (-1, 1)),
    ]
    size = rng.uniform(0.014, 0.022)
    loose = [
        _box(size, 0.8 * size, 0.7 * size, (0.25 * x, -0.22 * y, 0.4 * size + t)),
        _box(0.7 * size, 1.4 * size, 0.6 * size, (-0.3 * x, 0.1 * y, 0.35 * size + t)),
    ]
    return Varied(_joined(*walls, *loose), feature=np.array([0.25 * x, -0.22 * y, size]))


def box_with_lid(rng):
    """A box whose lid was put on turned and shifted."""
    x, y, z = rng.uniform(0.09, 0.12), rng.uniform(0.06, 0.08), rng.uniform(0.05, 0.07)
    lid = _box(1.04 * x, 1.04 * y, 0.012)
    lid.apply_transform(trimesh.transformations.rotation_matrix(rng.uniform(0.1, 0.16), Z))
    lid.apply_translation((0.05 * x, 0.04 * y, z / 2))
    return Varied(_joined(_box(x, y, z), lid), feature=z * Z)


def marker_with_clip(rng):
    """A marker with a clip: one plane, no axis and none across."""
    made = turned(marker(rng))
    top = made.vertices[:, 2].max()
    reach = np.ptp(made.vertices[:, 0]) / 2.0
    clip = _box(0.35 * reach, 0.5 * reach, 0.3 * top, (1.45 * reach, 0, 0.8 * top))
    bridge = _box(0.8 * reach, 0.5 * reach, 0.03 * top, (1.1 * reach, 0, 0.94 * top))
    return Varied(
        _joined(made, clip, bridge), planes=_through(Y), feature=0.8 * top * Z + reach * X
    )


def mug(rng):
    """A cup with a handle: the plane through the handle alone."""
    made = turned(cup(rng))
    r, h = np.ptp(made.vertices[:, 0]) / 2.0, made.vertices[:, 2].max()
    around = np.linspace(0.0, 2.0 * np.pi, 13)
    loop = turned([(0.25 * h + 0.006 * np.cos(a), 0.006 * np.sin(a)) for a in around])
    loop.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, X))
    loop.apply_translation((r, 0, 0.5 * h))
    return Varied(_joined(made, loop), planes=_through(Y), feature=r * X + 0.5 * h * Z)


def oval_can(rng):
    """A tin of fish: three planes, no axis."""
    made = turned(can(rng))
    points = np.asarray(made.vertices) - np.asarray(made.vertices).mean(axis=0) * Z
    points = defects.oval(points, rng.uniform(0.05, 0.12))
    return Varied(Mesh(points, np.asarray(made.faces)), planes=_through(X, Y), unclear=_through(Z))


def column(rng):
    """A column with six to ten sides: planes at every side and corner, no continuous axis."""
    sides = int(rng.choice([6, 8, 10]))
    r, h = rng.uniform(0.015, 0.03), rng.uniform(0.08, 0.12)
    made = trimesh.creation.cylinder(r, h, sections=sides)
    angle = np.pi * np.arange(sides) / sides
    around = [np.array([np.cos(a), np.sin(a), 0.0]) for a in angle]
    return Varied(_joined(made), planes=_through(Z, *around))


def banana(rng):
    """A rod bent by a twentieth: the plane of its bend, and the one across."""
    r, h = rng.uniform(0.012, 0.018), rng.uniform(0.13, 0.17)
    made = turned(_rounded([(0, 0), (r, 0.03 * h), (r, 0.97 * h), (0, h)]))
    points = np.asarray(made.vertices) - 0.5 * h * Z
    points = defects.bent(points, rng.uniform(0.05, 0.08))
    return Varied(Mesh(points, np.asarray(made.faces)), planes=_through(Y, Z))


def wedge(rng):
    """A box narrower at one end by a tenth of its length: two planes."""
    x, y, z = rng.uniform(0.1, 0.14), rng.uniform(0.06, 0.08), rng.uniform(0.04, 0.05)
    made = _box(x, y, z)
    points = np.asarray(made.vertices).copy()
    points[:, 1] *= 1.0 + rng.uniform(0.15, 0.3) * points[:, 0] / (x / 2.0)
    return Varied(Mesh(points, np.asarray(made.faces)), planes=_through(Y, Z))


def leaning_box(rng):
    """A box sheared by a twentieth of its size: the plane along the shear."""
    x, y, z = rng.uniform(0.09, 0.12), rng.uniform(0.05, 0.07), rng.uniform(0.07, 0.09)
    made = _box(x, y, z)
    points = np.asarray(made.vertices).copy()
    points[:, 0] += rng.uniform(0.12, 0.2) * points[:, 2]
    return Varied(Mesh(points, np.asarray(made.faces)), planes=_through(Y))


def jug(rng):
    """A bowl with a spout drawn out of its rim: one plane."""
    made = turned(bowl(rng))
    points = np.asarray(made.vertices).copy()
    radius, angle = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
    share = np.clip(points[:, 2] / points[:, 2].max() * 2.0 - 1.0, 0.0, 1.0)
    pull = 1.0 + rng.uniform(0.2, 0.3) * share * np.exp(-((angle / 0.35) ** 2)) * (radius > 0)
    points[:, :2] *= pull[:, None]
    feature = points[:, 0].max() * X + points[:, 2].max() * Z
    return Varied(Mesh(points, np.asarray(made.faces)), planes=_through(Y), feature=feature)


def brick(rng):
    """A dented, engraved box: its planes are true, as the damage is no other shape."""
    x, y, z = rng.uniform(0.1, 0.13), rng.uniform(0.06, 0.08), rng.uniform(0.03, 0.045)
    made = _box(x, y, z)
    points = defects.dented(np.asarray(made.vertices), rng.uniform(0.008, 0.015), rng)
    points = defects.engraved(points, 0.003, rng)
    return Varied(Mesh(points, np.asarray(made.faces)), planes=_through(X, Y, Z))


def knob_box(rng):
    """A box with a knob off the middle of a face: only the plane through the knob."""
    x, y, z = rng.uniform(0.08, 0.12), rng.uniform(0.05, 0.07), rng.uniform(0.05, 0.07)
    r = rng.uniform(0.008, 0.011)
    knob = turned([(0, 0), (r, 0), (r, 2 * r), (0, 2 * r)])
    place = np.array([rng.uniform(0.2, 0.3) * x, 0.0, z / 2])
    knob.apply_translation(place)
    images = tuple(place * signs for signs in ((-1, 1, 1), (1, 1, -1), (-1, 1, -1)))
    made, near = _joined(_box(x, y, z), knob), 0.25 * x * X + z * Z
    return Varied(made, planes=_through(Y), feature=near, images=images)


def spray(rng):
    """A can with a nozzle that points to one side: one plane, no axis."""
    made = turned(bottle(rng))
    top = made.vertices[:, 2].max()
    nozzle = _box(0.045, 0.012, 0.012, (0.0225, 0, top + 0.005))
    return Varied(_joined(made, nozzle), planes=_through(Y), feature=top * Z)


OTHERS: tuple[Draw, ...] = (
    *(tray_of_parts, box_with_lid, marker_with_clip, mug, oval_can, column, banana, wedge),
    *(leaning_box, jug, brick, knob_box, spray),
)
