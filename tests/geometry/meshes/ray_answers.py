"""Figures computed with rays: a view, crossings, windings, contacts, collision and labels."""

import json
import sys

import numpy as np
import trimesh

from pipelines.configs import LabelConfig
from pipelines.geometry.camera import Intrinsics
from pipelines.geometry.meshes.line_crossings import line_crossings
from pipelines.geometry.meshes.mesh import Mesh, sample_surface
from pipelines.geometry.meshes.ray_search import has_embree
from pipelines.geometry.meshes.winding import looks_inward
from pipelines.geometry.rendering import Scene, cast_view
from pipelines.geometry.transforms import make_pose, random_rotation
from pipelines.metrics.antipodal import contact_pair_score
from pipelines.metrics.contacts import close_fingers
from pipelines.metrics.mesh_collision import MeshCollider
from pipelines.synthesis.labels.grasp_sampling import sample_grasp_label
from tests.metrics.shapes import gripper, random_grasps

CAMERA = Intrinsics(150.0, 150.0, 63.5, 47.5, 128, 96)


def ring() -> Mesh:
    made = trimesh.creation.torus(0.04, 0.015)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def answers() -> dict[str, float]:
    """Return the figures by name."""
    mesh, rng = ring(), np.random.default_rng(0)
    scene = Scene([mesh], [make_pose(random_rotation(rng), [0.0, 0.0, 0.4])])
    view = cast_view(scene, CAMERA, np.eye(4))
    points, normals, _ = sample_surface(mesh, 500, rng)
    crossings = line_crossings(mesh, points + 0.2 * normals, -normals, 1.0)
    grasps = random_grasps(rng, 300, spread=0.05)
    pairs = contact_pair_score(close_fingers(mesh, grasps, 0.1))
    label = sample_grasp_label(mesh, LabelConfig(num_points=2), np.random.default_rng(1))
    return {
        "pixels": int((view.depth > 0).sum()),
        "depth": float(view.depth.sum()),
        "crossings": int(crossings.count.sum()),
        "inward": int(looks_inward(mesh.submesh(np.arange(len(mesh.faces)) % 7 > 0)).sum()),
        "contact pairs": float(pairs.sum()),
        "in collision": int(MeshCollider(mesh).hits(grasps, gripper()).sum()),
        "labels that hold": int((label.min_friction > 0).sum()),
        "friction of labels": float(label.min_friction.sum()),
    }


def main() -> None:
    """Print the figures, and whether Embree was used, as JSON."""
    sys.stdout.write(json.dumps(answers() | {"embree": has_embree()}))
