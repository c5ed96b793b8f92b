"""The compatible contact search against graspnetAPI's verdicts, and against exact contacts."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.dataset.meshes import read_mesh
from pipelines.geometry.meshes.signed_distance import signed_distance_grid
from pipelines.geometry.numerics.single_precision import single_precision_grid
from pipelines.grasping.grasps import from_graspnet
from pipelines.metrics.contacts import close_fingers
from pipelines.metrics.force_closure import min_friction, on_grid
from pipelines.metrics.graspnet.grid_contacts import close_fingers_on_grid
from pipelines.storage.array_files import read_npy, read_npz
from tests.metrics.shapes import ball, box, random_grasps

PEER_GRID = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)
_GRIDS = {}


def peer_grid(path):
    if path.stem not in _GRIDS:
        _GRIDS[path.stem] = single_precision_grid(read_mesh(path))
    return _GRIDS[path.stem]


@pytest.mark.parametrize("kind", ["antipodal", "label"])
@pytest.mark.parametrize("shape", ["box", "cylinder", "sphere"])
def test_verdicts_on_all_grasps_equal_the_peers(shared, shape, kind):
    oracle = shared / "oracle"
    grasps = from_graspnet(read_npy(oracle / f"{shape}_{kind}.npy"))
    contacts = close_fingers_on_grid(peer_grid(oracle / f"{shape}.obj"), grasps, grasps.width)
    peer = read_npz(oracle / f"{shape}_{kind}.eval.npz")
    assert_array_equal(contacts.found, peer["found"])
    found = peer["found"]
    assert_allclose(contacts.points[found], peer["contacts"][found], atol=1e-8)
    normals = np.abs(np.einsum("nki,nki->nk", contacts.normals[found], peer["normals"][found]))
    assert normals.min() > 1.0 - 1e-6
    grid = on_grid(min_friction(contacts), PEER_GRID)
    assert_array_equal(np.where(np.isfinite(grid), grid, -1.0), peer["mu_grid"])


def test_both_modes_find_the_same_contacts_on_flat_faces():
    mesh = box(0.04, 0.05, 0.06)
    grasps = random_grasps(np.random.default_rng(3), 400, 0.005)
    ours = close_fingers(mesh, grasps, 0.09)
    theirs = close_fingers_on_grid(single_precision_grid(mesh), grasps, 0.09)
    both = ours.found & theirs.found
    assert both.sum() > 100
    gap = np.linalg.norm(ours.points - theirs.points, axis=-1)[both]
    assert np.median(gap) < 1e-7
    assert gap.max() < 5e-4  # near an edge the parabola rounds it off


@pytest.mark.parametrize("width", [0.0, 1e-9])
def test_closed_fingers_have_no_contact_and_no_fault(width):
    grasps = random_grasps(np.random.default_rng(1), 20, 0.02)
    contacts = close_fingers_on_grid(single_precision_grid(box(0.04, 0.05, 0.06)), grasps, width)
    assert not contacts.found.any()


def test_the_grid_equals_the_exact_one_except_for_rounding():
    mesh = ball(0.03)
    exact, single = signed_distance_grid(mesh), single_precision_grid(mesh)
    near = np.abs(exact.values) < 2.0 * exact.spacing
    assert_allclose(single.values[near], exact.values[near], atol=1e-8)
    assert_array_equal(single.values[near], single.values[near].astype(np.float32))
