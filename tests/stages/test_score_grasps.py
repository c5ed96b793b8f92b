"""score-grasps: any rows on any mesh, named faults, and no lost row."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from pipelines import score_grasps
from pipelines.configs import ScoreGraspsConfig
from pipelines.dataset.graspnet.signed_distance import write_sdf
from pipelines.dataset.meshes import write_mesh
from pipelines.errors import FormatError, StaleOutputError, SymgraspError
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.meshes.signed_distance import SignedDistanceGrid
from pipelines.geometry.transforms import make_pose, random_rotation, rotation_about
from pipelines.grasp_files.grasp_rows import VERDICT_ARRAYS
from pipelines.grasping.grasps import GraspPoses, to_graspnet
from pipelines.storage.array_files import read_npz, write_npy
from symgrasp_cli.app import app
from tests.metrics.shapes import box, moved, random_grasps

SIDES = (0.04, 0.05, 0.06)
TILT = rotation_about([0.0, 0.0, 1.0], 0.3)  # about the approach


@pytest.fixture
def mesh_path(tmp_path):
    write_mesh(tmp_path / "box.ply", box(*SIDES))
    return tmp_path / "box.ply"


def rows_across(count=4) -> np.ndarray:
    """Grasps across the x sides of the box, from above, tips at its middle."""
    rows = np.zeros((count, 17))
    rows[:, 1], rows[:, 2], rows[:, 3], rows[:, 16] = 0.06, 0.02, 0.03, -1
    rows[:, 4:13] = np.array([[0, 1, 0], [0, 0, -1], [-1, 0, 0]]).ravel()
    rows[:, 15] = 0.03
    return rows


def run(mesh_path, rows, *, compatible=False, overwrite=False, mesh_scale=None):
    path, out = mesh_path.with_name("rows.npy"), mesh_path.with_name("verdicts.npz")
    write_npy(path, rows)
    config = ScoreGraspsConfig(compatible=compatible)
    report = score_grasps.run(
        mesh_path, path, out, config, mesh_scale=mesh_scale, overwrite=overwrite
    )
    return report, read_npz(out)


def test_a_mesh_turned_inside_out_is_scored_as_if_turned_back(mesh_path):
    _, verdicts = run(mesh_path, rows_across())
    solid = box(*SIDES)
    write_mesh(mesh_path, Mesh(solid.vertices, solid.faces[2:, ::-1]))  # and with one side open
    report, turned = run(mesh_path, rows_across(), overwrite=True)
    assert report.notes["box.ply"] == "turned its triangles, which looked inward"
    np.testing.assert_array_equal(turned["min_friction"], verdicts["min_friction"])
    assert turned["found"].all()


def test_verdicts_do_not_replace_a_file_of_another_program_even_on_request(mesh_path):
    np.savez(mesh_path.with_name("verdicts.npz"), mine=np.zeros(1))
    with pytest.raises(SymgraspError, match="is no output of score-grasps"):
        run(mesh_path, rows_across(), overwrite=True)


def test_a_mesh_in_millimetres_is_refused_unless_its_unit_is_stated(mesh_path):
    _, verdicts = run(mesh_path, rows_across())
    solid = box(*SIDES)
    write_mesh(mesh_path, Mesh(1000.0 * solid.vertices, solid.faces))
    with pytest.raises(SymgraspError, match="looks like millimetres"):
        run(mesh_path, rows_across(), overwrite=True)
    _, scaled = run(mesh_path, rows_across(), overwrite=True, mesh_scale=0.001)
    np.testing.assert_allclose(scaled["contacts"], verdicts["contacts"], atol=1e-7)


def test_a_tilted_grasp_across_two_faces_needs_the_tangent_of_its_tilt(mesh_path):
    rows = rows_across()
    rows[:, 4:13] = (TILT @ rows[:, 4:13].reshape(-1, 3, 3)).reshape(-1, 9)
    report, verdicts = run(mesh_path, rows)
    assert report.exit_code == 0
    assert verdicts["found"].all()
    np.testing.assert_allclose(verdicts["min_friction"], np.tan(0.3))
    assert set(verdicts["min_friction_grid"]) == {0.4}
    np.testing.assert_allclose(np.abs(verdicts["contacts"][..., 0]), 0.02)
    np.testing.assert_allclose(verdicts["antipodal"], np.cos(0.3) ** 2)
    assert not verdicts["collision"].any()
    assert not verdicts["empty"].any()


def test_the_compatible_mode_differs_only_by_missed_contacts_and_edges(mesh_path):
    rows = to_graspnet(
        random_grasps(np.random.default_rng(0), 500, 0.005), 1.0, tip_reach=0.0, depth=0.02
    )
    rows[:, 1] = 0.09
    exact = run(mesh_path, rows)[1]
    theirs = run(mesh_path, rows, compatible=True, overwrite=True)[1]
    both = exact["found"] & theirs["found"]
    assert both.sum() > 100
    assert not (theirs["found"] & ~exact["found"]).any()
    same = exact["min_friction_grid"] == theirs["min_friction_grid"]
    assert same[both].mean() > 0.9


def test_a_grid_next_to_the_mesh_is_read_as_by_graspnetapi(mesh_path):
    rows = rows_across(2)
    rows[:, 4:13] = (TILT @ rows[:, 4:13].reshape(-1, 3, 3)).reshape(-1, 9)
    computed = run(mesh_path, rows, compatible=True)[1]
    assert computed["found"].all()
    elsewhere = SignedDistanceGrid(np.ones((9, 9, 9)), -np.full(3, 0.05), 0.0125)  # all air
    write_sdf(mesh_path.with_suffix(".sdf"), elsewhere)
    with pytest.raises(StaleOutputError):
        run(mesh_path, rows, compatible=True)
    assert not run(mesh_path, rows, compatible=True, overwrite=True)[1]["found"].any()
    assert run(mesh_path, rows, overwrite=True)[1]["found"].all()  # the exact mode needs none


def test_openings_beyond_the_clip_width_are_named(mesh_path):
    rows = rows_across()
    rows[0, 1] = np.float32(0.1)
    assert "rows.npy" not in run(mesh_path, rows)[0].notes
    rows[:2, 1] = 0.12, 0.11
    note = run(mesh_path, rows, overwrite=True)[0].notes["rows.npy"]
    assert "clipped to 0.1 m: 2 openings; --clip-width" in note
    rows[1, 1] = 0.05
    note = run(mesh_path, rows, overwrite=True)[0].notes["rows.npy"]
    assert "clipped to 0.1 m: 1 opening; --clip-width" in note


def test_grasps_that_are_all_far_from_the_mesh_get_a_note(mesh_path):
    rows = rows_across()
    rows[:, 15] = 30.0  # millimetres
    note = run(mesh_path, rows)[0].notes["rows.npy"]
    assert "nearest grasp is 30 m from the mesh; translations are metres" in note
    rows[1, 0] = np.nan  # a row that is no grasp is not near either
    assert "nearest grasp is 30 m" in run(mesh_path, rows, overwrite=True)[0].notes["rows.npy"]
    rows[0, 15] = 0.03
    assert "rows.npy" not in run(mesh_path, rows, overwrite=True)[0].notes


@pytest.mark.parametrize("compatible", [False, True])
def test_colliding_and_empty_grasps_are_marked(mesh_path, compatible):
    rows = rows_across(3)
    rows[1, 1] = 0.03  # the fingers are in the box
    rows[2, 13] = 0.3
    verdicts = run(mesh_path, rows, compatible=compatible)[1]
    assert verdicts["collision"].tolist()[:2] == [False, True]
    assert verdicts["empty"].tolist() == [False, False, True]
    assert verdicts["min_friction_grid"][2] == -1.0


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=8, deadline=None)
def test_moving_grasps_and_mesh_together_changes_no_verdict_of_the_exact_mode(seed):
    rng = np.random.default_rng(seed)
    T = make_pose(random_rotation(rng), rng.normal(size=3))
    mesh, grasps = box(*SIDES), random_grasps(rng, 60, 0.015)
    opened = GraspPoses(grasps.rotation, grasps.translation, rng.uniform(0.05, 0.1, 60))
    here, there = (
        score_grasps.score(m, to_graspnet(g, 1.0, tip_reach=0.0, depth=0.02), ScoreGraspsConfig())
        for m, g in ((mesh, opened), (moved(mesh, T), opened.transformed(T)))
    )
    np.testing.assert_array_equal(there["found"], here["found"])
    np.testing.assert_allclose(there["min_friction"], here["min_friction"], rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(there["antipodal"], here["antipodal"], atol=1e-7)
    np.testing.assert_array_equal(there["empty"], here["empty"])
    expected = np.where(here["found"][:, None, None], transform_all(T, here["contacts"]), np.nan)
    np.testing.assert_allclose(there["contacts"], expected, atol=1e-7)
    assert (there["collision"] == here["collision"]).mean() >= 0.95  # touches within rounding


def transform_all(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ T[:3, :3].T + T[:3, 3]


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=8, deadline=None)
def test_a_finer_friction_grid_lies_between_the_exact_friction_and_a_coarser_one(seed):
    rng = np.random.default_rng(seed)
    rows = to_graspnet(random_grasps(rng, 60, 0.01), 1.0, tip_reach=0.0, depth=0.02)
    rows[:, 1] = 0.09
    coarse = ScoreGraspsConfig().friction_grid
    fine = tuple(sorted({*coarse, *rng.uniform(0.05, 1.2, 7).tolist()}))
    stepped = {
        grid: score_grasps.score(box(*SIDES), rows, ScoreGraspsConfig(friction_grid=grid))
        for grid in (coarse, fine)
    }
    held = stepped[coarse]["min_friction_grid"] > 0.0
    np.testing.assert_array_equal(held, stepped[fine]["min_friction_grid"] > 0.0)
    exact, finer = stepped[fine]["min_friction"], stepped[fine]["min_friction_grid"]
    assert (exact[held] <= finer[held]).all()
    assert (finer[held] <= stepped[coarse]["min_friction_grid"][held]).all()


def test_bad_rows_are_named_and_the_rest_is_scored(mesh_path):
    rows = rows_across(5)
    rows[1, 4] = np.nan
    rows[2, 4:13] = np.ones(9)
    rows[3, 1] = -0.01
    report, verdicts = run(mesh_path, rows)
    assert report.exit_code == 1
    assert set(report.failed) == {"row 1", "row 2", "row 3"}
    assert verdicts["found"].tolist() == [True, False, False, False, True]


@pytest.mark.parametrize("compatible", [False, True])
def test_rows_beyond_100_metres_are_named_and_other_far_rows_touch_nothing(mesh_path, compatible):
    rows = rows_across(6)
    rows[:4, [13, 14, 3, 15]] += np.diag([1e300, 1e7, -101.0, 5.0])
    rows[4, 13:16] = -99.0
    report, verdicts = run(mesh_path, rows, compatible=compatible)
    assert sorted(report.failed) == ["row 0", "row 1", "row 2"]
    assert all("beyond 100 metres" in sentence for sentence in report.failed.values())
    assert not verdicts["found"][:5].any()
    assert verdicts["found"][5] or compatible  # the peer loses contacts on flat faces


def test_a_mesh_with_holes_is_scored_with_a_note(mesh_path):
    mesh = box(*SIDES)
    write_mesh(mesh_path, Mesh(mesh.vertices, mesh.faces[:-1]))
    report, _ = run(mesh_path, rows_across(), compatible=True)
    assert report.exit_code == 0
    assert "not closed" in report.notes["box.ply"]
    assert "box.ply" not in run(mesh_path, rows_across(), overwrite=True)[0].notes


def test_a_rotation_rounded_to_half_precision_is_a_rotation(mesh_path):
    grasps = random_grasps(np.random.default_rng(0), 50, 0.02)
    rows = to_graspnet(grasps, 1.0, tip_reach=0.0, depth=0.02)
    rows[:, 4:13] = rows[:, 4:13].astype(np.float16)
    assert run(mesh_path, rows)[0].exit_code == 0


def test_no_rows_give_no_verdicts(mesh_path):
    report, verdicts = run(mesh_path, np.zeros((0, 17)))
    assert report.exit_code == 0
    assert all(len(verdicts[name]) == 0 for name in VERDICT_ARRAYS)
    assert len(run(mesh_path, np.zeros((0, 17)), compatible=True, overwrite=True)[1]["found"]) == 0


def test_planar_rows_are_refused_with_the_expected_columns(mesh_path):
    with pytest.raises(FormatError, match=r"planar grasps.*17"):
        run(mesh_path, np.zeros((3, 7)))


def test_other_settings_are_refused_and_the_same_skipped(mesh_path):
    run(mesh_path, rows_across())
    assert run(mesh_path, rows_across())[0].skipped
    with pytest.raises(StaleOutputError):
        run(mesh_path, rows_across(), compatible=True)


def test_the_command_scores_grasps(mesh_path):
    rows, out = mesh_path.with_name("rows.npy"), mesh_path.with_name("v.npz")
    write_npy(rows, rows_across())
    result = CliRunner().invoke(
        app, ["score-grasps", str(mesh_path), str(rows), "--out", str(out), "--compatible"]
    )
    assert result.exit_code == 0, result.output
    assert set(read_npz(out)) == set(VERDICT_ARRAYS)
