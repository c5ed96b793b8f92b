"""Trials of good and bad grasps with an obvious outcome."""

import numpy as np
import pytest
import trimesh

from pipelines.configs import SimulateConfig
from pipelines.geometry.meshes.mesh import Mesh
from pipelines.geometry.transforms import make_pose, rotation_about
from pipelines.grasp_files.gripper_files import load_gripper, preset_names
from pipelines.grasping.grasps import GraspPoses
from pipelines.runtime.physics import mujoco
from pipelines.simulation.trial import Outcome, Trial
from pipelines.synthesis.objects.decomposition import hull_of_points
from tests.metrics.shapes import ball, box, moved

X, Y, Z = np.eye(3)
DOWN = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # approach down, closing along y
LEVEL = np.eye(3)  # approach along x, closing along y


def can(radius: float, height: float) -> Mesh:
    made = trimesh.creation.cylinder(radius, height, sections=64)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def wedge(slope: float) -> Mesh:
    """A bar along x, 6 cm high, whose sides towards +-y lean inward by `slope` degrees."""
    lean = 0.06 * np.tan(np.radians(slope))
    outline = [(-0.04, 0.0), (0.04, 0.0), (0.04 - lean, 0.06), (lean - 0.04, 0.06)]
    corners = np.array([(x, y, z - 0.03) for x in (-0.03, 0.03) for y, z in outline])
    hull = trimesh.convex.convex_hull(corners)
    return Mesh(np.asarray(hull.vertices), np.asarray(hull.faces))


# A shape, the height of its middle, and the width and height of a centred antipodal grasp.
SHAPES = {
    "box": (box(0.06, 0.04, 0.10), 0.05, 0.04, 0.03),
    "can": (can(0.025, 0.08), 0.04, 0.05, 0.01),
    "ball": (ball(0.03), 0.03, 0.06, 0.0),
}


def attempt(
    mesh: Mesh,
    height: float,
    width: float,
    above: float,
    friction: float,
    rotation: np.ndarray = DOWN,
    gripper: str = "rg2",
) -> Outcome:
    """Try a grasp `above` the middle of an object that stands on the table at `height`."""
    grasp = GraspPoses(rotation, np.array([0.0, 0.0, height + above]), np.array(width))
    pose = make_pose(np.eye(3), [0.0, 0.0, height])
    fingers, config = load_gripper(gripper), SimulateConfig()
    return Trial.of({7: [mesh]}, {7: pose}, 7, grasp, fingers, config).run(friction)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("friction", [0.3, 0.8])
def test_a_centred_antipodal_grasp_lifts(shape, friction):
    outcome = attempt(*SHAPES[shape], friction)
    assert outcome.reason == "held"
    assert outcome.slip < 0.002
    assert outcome.turn < 2.0


@pytest.mark.parametrize("shape", SHAPES)
def test_the_same_grasp_drops_with_slippery_fingers(shape):
    assert attempt(*SHAPES[shape], 0.05).reason == "not lifted"


@pytest.mark.parametrize(("friction", "reason"), [(0.08, "slipped"), (0.085, "held")])
def test_an_object_that_slides_along_the_lift_and_stays_in_the_fingers_slips(friction, reason):
    mesh, height, width, above = SHAPES["box"]
    grasp = GraspPoses(DOWN, np.array([0.0, 0.0, height + above]), np.array(width))
    pose, config = make_pose(np.eye(3), [0.0, 0.0, height]), SimulateConfig(max_slip=0.01)
    trial = Trial.of({7: [mesh]}, {7: pose}, 7, grasp, load_gripper("rg2"), config)
    outcome = trial.run(friction)
    assert outcome.reason == reason
    assert 0.005 < outcome.slip < 0.03


@pytest.mark.parametrize(
    ("slip", "turn", "reason"),
    [
        (0.049, 29.0, "held"),
        (0.051, 29.0, "slipped"),
        (0.049, 31.0, "turned"),
        (1.0, 99.0, "slipped"),
    ],
)
def test_slip_and_turn_have_limits(slip, turn, reason, monkeypatch):
    mesh, height, width, above = SHAPES["box"]
    grasp = GraspPoses(DOWN, np.array([0.0, 0.0, height + above]), np.array(width))
    pose, config = (
        make_pose(np.eye(3), [0.0, 0.0, height]),
        SimulateConfig(max_slip=0.05, max_turn=30.0),
    )
    trial = Trial.of({7: [mesh]}, {7: pose}, 7, grasp, load_gripper("rg2"), config)
    monkeypatch.setattr(Trial, "_is_raised", lambda *_: True)
    assert trial._verdict(-1.0, slip, turn) == reason  # from one metre below


def test_a_gripper_opens_no_wider_than_it_can():
    wide = box(0.06, 0.14, 0.10)
    assert attempt(wide, 0.05, 0.14, 0.03, 0.8).reason == "collision"


def test_a_wall_next_to_the_object_stops_the_approach_and_a_far_one_does_not():
    mesh, height, width, above = SHAPES["box"]
    grasp = GraspPoses(DOWN, np.array([0.0, 0.0, height + above]), np.array(width))
    pose, fingers = make_pose(np.eye(3), [0.0, 0.0, height]), load_gripper("rg2")
    for away, reason in ((0.03, "collision"), (0.3, "held")):
        wall = moved(box(0.5, 0.01, 0.4), make_pose(np.eye(3), [0.0, away, 0.2]))
        trial = Trial.of({7: [mesh]}, {7: pose}, 7, grasp, fingers, SimulateConfig(), [wall])
        assert trial.run(0.5).reason == reason


@pytest.mark.parametrize("gripper", preset_names())
def test_every_preset_lifts_a_can(gripper):
    assert attempt(*SHAPES["can"], 0.5, gripper=gripper).reason == "held"


@pytest.mark.parametrize("axis", [X, Z])
@pytest.mark.parametrize("friction", [0.3, 0.8])
def test_the_grasp_of_the_box_turned_by_30_degrees_hits_it_if_it_opens_no_wider(axis, friction):
    turned = rotation_about(axis, np.radians(30.0)) @ DOWN
    assert attempt(*SHAPES["box"], friction, turned).reason == "collision"


def opened_for_30_degrees(axis: np.ndarray, angle: float, friction: float) -> Outcome:
    """The centred grasp of the box, turned by `angle` degrees, by a gripper clear of the box.

    The gripper opens for the chord of 4.6 cm through the box's middle at 30 degrees.
    """
    mesh, height, width, above = SHAPES["box"]
    turned = rotation_about(axis, np.radians(angle)) @ DOWN
    return attempt(mesh, height, width / np.cos(np.radians(30.0)), above, friction, turned)


@pytest.mark.parametrize("friction", [0.3, 0.5])
def test_the_grasp_of_the_box_tilted_by_30_degrees_loses_it_below_the_tangent(friction):
    # The gripper leans sideways: one finger meets a side with its tip, the other one the opposite
    # edge, and the line between them is 30 degrees off the sides' normals. Below tan 30 = 0.58
    # only gravity keeps the box from turning until its sides are flat against the fingers.
    assert opened_for_30_degrees(X, 0.0, friction).reason == "held"
    outcome = opened_for_30_degrees(X, 30.0, friction)
    assert outcome.reason in {"not lifted", "dropped", "slipped", "turned"}
    assert outcome.turn > 20.0


def test_the_grasp_of_the_box_tilted_by_30_degrees_holds_it_above_the_tangent():
    assert opened_for_30_degrees(X, 30.0, 0.8).reason == "held"


def test_fingers_turned_about_the_vertical_push_the_box_straight_before_they_lift_it():
    # Fingers are 2 cm wide: their edges turn the box on the table until it fits (D. 48).
    assert opened_for_30_degrees(Z, 30.0, 0.3).reason == "held"


@pytest.mark.parametrize("shape", ["can", "ball"])
def test_a_turn_about_the_axis_of_a_round_object_does_not_change_the_outcome(shape):
    turned = rotation_about(Z, np.radians(30.0)) @ DOWN
    assert attempt(*SHAPES[shape], 0.3, turned).reason == "held"


def test_sides_that_lean_inward_hold_above_the_tangent_of_their_slope_only():
    # Squeezed fingers climb a slope of 25 degrees if friction is below tan 25 = 0.47.
    assert attempt(wedge(25.0), 0.03, 0.052, 0.01, 0.3).reason == "not lifted"
    assert attempt(wedge(25.0), 0.03, 0.052, 0.01, 0.8).reason == "held"


def test_a_long_bar_held_at_its_end_turns_and_held_in_its_middle_does_not():
    bar = box(0.24, 0.02, 0.02)
    at_end = GraspPoses(DOWN, np.array([0.1, 0.0, 0.012]), np.array(0.02))
    pose = make_pose(np.eye(3), [0.0, 0.0, 0.01])
    fingers, config = load_gripper("rg2"), SimulateConfig()
    outcome = Trial.of({0: [bar]}, {0: pose}, 0, at_end, fingers, config).run(0.5)
    assert outcome.reason != "held"
    assert attempt(bar, 0.01, 0.02, 0.002, 0.5).reason == "held"


def test_a_grasp_next_to_the_object_lifts_nothing():
    pose = make_pose(np.eye(3), [0.2, 0.0, 0.03])
    grasp = GraspPoses(DOWN, np.array([0.0, 0.0, 0.03]), np.array(0.05))
    trial = Trial.of({0: [ball(0.03)]}, {0: pose}, 0, grasp, load_gripper("rg2"), SimulateConfig())
    assert trial.run(0.5).reason == "not lifted"


def test_fingers_in_the_table_are_a_collision():
    assert attempt(ball(0.03), 0.03, 0.06, -0.03, 0.5).reason == "collision"


def test_a_palm_that_lands_on_the_object_is_a_collision():
    tall = box(0.04, 0.04, 0.12)
    assert attempt(tall, 0.06, 0.04, 0.03, 0.5).reason == "held"
    assert attempt(tall, 0.06, 0.04, 0.0, 0.5).reason == "collision"


@pytest.mark.parametrize(("away", "reason"), [(0.0, "collision"), (0.2, "held")])
def test_an_approach_path_that_starts_inside_a_light_neighbour_is_a_collision(away, reason):
    # A small box that the palm, 10 cm and its fingers' 4.5 cm behind the can, would push aside.
    poses = {0: make_pose(np.eye(3), [0, 0, 0.04]), 1: make_pose(np.eye(3), [-0.15, away, 0.02])}
    grasp = GraspPoses(LEVEL, np.array([0.0, 0.0, 0.04]), np.array(0.05))
    objects = {0: [can(0.025, 0.08)], 1: [box(0.03, 0.03, 0.04)]}
    trial = Trial.of(objects, poses, 0, grasp, load_gripper("rg2"), SimulateConfig())
    assert trial.run(0.5).reason == reason


def test_tugs_pull_out_an_object_that_lifting_alone_leaves_in_the_gripper():
    mesh, height, width, above = SHAPES["ball"]
    grasp = GraspPoses(DOWN, np.array([0.0, 0.0, height + above]), np.array(width))
    pose = make_pose(np.eye(3), [0.0, 0.0, height])
    reasons = [
        Trial.of({0: [mesh]}, {0: pose}, 0, grasp, load_gripper("rg2"), SimulateConfig(tug=tug))
        .run(0.1)
        .reason
        for tug in (0.0, 40.0)
    ]
    assert reasons == ["held", "dropped"]


def test_soft_pads_resist_turning_in_proportion_to_friction():
    # A ball whose counterweight, 4 cm aside, turns it about the line of the fingers.
    lopsided = [ball(0.02), moved(box(0.02, 0.02, 0.02), make_pose(np.eye(3), [0.04, 0, -0.01]))]
    grasp = GraspPoses(DOWN, np.array([0.0, 0.0, 0.02]), np.array(0.04))
    trial = Trial.of({0: lopsided}, {0: make_pose(np.eye(3), [0, 0, 0.02])}, 0, grasp,
                     load_gripper("rg2"), SimulateConfig())  # fmt: skip
    assert trial.run(0.15).reason == "turned"
    assert trial.run(0.8).turn < 2.0


def test_a_wall_of_a_tray_is_held_with_one_finger_inside():
    bottom = moved(box(0.08, 0.1, 0.01), make_pose(np.eye(3), [0.0, 0.0, 0.005]))
    walls = [
        moved(box(0.08, 0.006, 0.05), make_pose(np.eye(3), [0.0, y, 0.03])) for y in (0.047, -0.047)
    ]
    filled = hull_of_points(np.concatenate([wall.vertices for wall in walls]))
    grasp = GraspPoses(DOWN, np.array([0.0, 0.047, 0.045]), np.array(0.006))
    fingers, config = load_gripper("rg2"), SimulateConfig()
    outcomes = [
        Trial.of({0: [bottom, *pieces]}, {0: np.eye(4)}, 0, grasp, fingers, config).run(0.8).reason
        for pieces in (walls, [filled])
    ]
    assert outcomes == ["held", "collision"]


def test_a_trial_does_not_depend_on_those_before_it():
    mesh, height, width, above = SHAPES["can"]
    grasp = GraspPoses(DOWN, np.array([0.004, 0.003, height + above]), np.array(width))
    pose = make_pose(np.eye(3), [0.0, 0.0, height])
    trial = Trial.of({0: [mesh]}, {0: pose}, 0, grasp, load_gripper("rg2"), SimulateConfig())
    first = trial.run(0.5)
    assert trial.run(0.05) != first
    assert trial.run(0.5) == first


def test_a_scene_whose_simulation_diverges_is_no_success(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log of warnings there
    mesh, height, width, above = SHAPES["can"]
    grasp = GraspPoses(DOWN, np.array([0.0, 0.0, height + above]), np.array(width))
    pose = make_pose(np.eye(3), [0.0, 0.0, height])
    trial = Trial.of({0: [mesh]}, {0: pose}, 0, grasp, load_gripper("rg2"), SimulateConfig())
    close = Trial._close

    def break_and_close(self: Trial) -> None:
        self.data.qvel[:] = np.inf
        close(self)

    monkeypatch.setattr(Trial, "_close", break_and_close)
    assert trial.run(0.5).reason == "diverged"
    monkeypatch.undo()
    assert trial.run(0.5).reason == "held"


def finger_force(trial: Trial) -> float:
    """Return the mean force of a finger on the object, newtons."""
    total, force = 0.0, np.zeros(6)
    for index, geoms in enumerate(trial.data.contact.geom):
        pair = trial.model.geom_bodyid[geoms]
        if trial.body in pair and np.isin(pair, trial.gripper.finger_bodies).any():
            mujoco.mj_contactForce(trial.model, trial.data, index, force)
            total += force[0]
    return total / 2.0


@pytest.mark.parametrize("width", [0.003, 0.012, 0.05])
def test_the_fingers_press_alike_on_thin_and_wide_places(width, monkeypatch):
    base, fin = box(0.07, 0.07, 0.04), box(0.05, width, 0.05)
    pieces = [base, moved(fin, make_pose(np.eye(3), [0.0, 0.0, 0.045]))]
    grasp = GraspPoses(DOWN, np.array([0.0, 0.0, 0.075]), np.array(width))
    pose = make_pose(np.eye(3), [0.0, 0.0, 0.02])
    trial = Trial.of({0: pieces}, {0: pose}, 0, grasp, load_gripper("rg2"), SimulateConfig())
    lift, forces = Trial._lift, []

    def note_and_lift(self: Trial) -> None:
        forces.append(finger_force(self))
        lift(self)

    monkeypatch.setattr(Trial, "_lift", note_and_lift)
    assert trial.run(0.8).reason == "held"
    assert forces == pytest.approx([trial.grip_force], rel=0.03)


def test_the_fingers_squeeze_with_multiples_of_the_objects_weight_up_to_their_limit():
    pose = make_pose(np.eye(3), [0.0, 0.0, 0.1])
    grasp = GraspPoses(DOWN, np.array([0.0, 0.0, 0.1]), np.array(0.05))
    config = SimulateConfig()
    forces = [
        Trial.of({0: [box(*size)]}, {0: pose}, 0, grasp, load_gripper("rg2"), config).grip_force
        for size in ((0.05, 0.05, 0.1), (0.2, 0.2, 0.2))
    ]
    assert forces == pytest.approx([8.0 * 9.81 * 0.1, config.max_force], rel=1e-3)
