"""Checks that the default weights are the shipped ones and give the expected grasps."""

import time
from pathlib import Path

import numpy as np

from pipelines.array_types import Array, Mask
from pipelines.configs import DoctorConfig, InferConfig
from pipelines.errors import SymgraspError
from pipelines.frames.frames import find_frames
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.health.checks import Check, Status
from pipelines.inference import models
from pipelines.inference.frame_grasps import Planner
from pipelines.storage.provenance import digest
from pipelines.storage.weights_manifest import (
    MADE_BY,
    GoldenGrasps,
    Manifest,
    manifest_path,
    read_manifest,
)

FRAMES = models.WEIGHTS / "frames"


def manifest_check(folder: Path = models.WEIGHTS) -> tuple[Manifest | None, Check]:
    """Return the manifest of the weights, None if it cannot be read, and its check."""
    path = manifest_path(folder)
    try:
        manifest = read_manifest(path)
    except (SymgraspError, OSError) as error:
        return None, Check("manifest", Status.FAIL, str(error))
    return manifest, Check("manifest", Status.OK, f"{len(manifest.files)} files named in {path}")


def file_check(name: str, expected: str, folder: Path = models.WEIGHTS) -> Check:
    """Check that a file of the weights has the digest of the shipped file."""
    path, title = folder / name, f"weights {Path(name).stem}"
    if not path.is_file():
        return Check(title, Status.FAIL, f"{path} does not exist; install symgrasp again")
    found = digest(path)
    if found != expected:
        other = f"{path} is {found}, shipped was {expected}; install symgrasp again"
        return Check(title, Status.FAIL, other)
    return Check(title, Status.OK, f"{found} as shipped")


def golden_check(manifest: Manifest, config: DoctorConfig, device: str = "cpu") -> Check:
    """Find grasps in the golden frame and compare them with those expected.

    A GPU samples other points of a region than a CPU (D. 62), so differences on a GPU are worth
    knowing, but no fault.
    """
    name = title(device)
    started = time.monotonic()
    result = golden_result(manifest.frame, device)
    seconds = time.monotonic() - started
    agreeing = int(np.count_nonzero(agree(best_grasps(result), manifest.grasps, config)))
    total = len(manifest.grasps)
    text = (
        f"{manifest.frame}: {agreeing} of {total} grasps as expected, within "
        f"{1000 * config.max_shift:g} mm and {np.degrees(config.max_turn):.0f} degrees"
    )
    if agreeing >= config.min_agreeing * total:
        return Check(name, Status.OK, f"{text}; {seconds:.1f} s, loading included")
    if device != "cpu":
        return Check(name, Status.WARN, f"{text}; a GPU samples other points")
    return Check(name, Status.FAIL, f"{text}; after an intended change, run {MADE_BY}")


def title(device: str) -> str:
    """Return the name of the comparison on a device."""
    return "golden frame" if device == "cpu" else f"golden frame {device}"


def golden_result(frame_name: str, device: str = "cpu") -> FrameResult:
    """Return the result of `infer` on a shipped frame with the default weights and settings.

    Raises:
        SymgraspError: the frame or the weights are missing or damaged.
    """
    found = [source for source in find_frames(FRAMES) if source.name == frame_name]
    if not found:
        raise SymgraspError(f"{FRAMES / frame_name} does not exist; install symgrasp again")
    config = InferConfig()
    with models.one_thread_each():
        planner = Planner(
            config,
            load_gripper(config.gripper),
            models.detector(models.DETECTOR_WEIGHTS, device),
            models.predictor(models.NETWORK_WEIGHTS, device),
            models.symmetry_critics(),
            models.grasp_critic(),
        )
        return planner.plan(found[0].read(), np.random.default_rng(0))


def best_grasps(result: FrameResult) -> GoldenGrasps:
    """Return the best grasp of each region that has one."""
    best, grasps = result.grasps.is_best, result.grasps
    return GoldenGrasps(
        np.asarray(grasps.rotation[best], np.float64),
        np.asarray(grasps.translation[best], np.float64),
        np.asarray(grasps.width[best], np.float64),
    )


def agree(found: GoldenGrasps, expected: GoldenGrasps, config: DoctorConfig) -> Mask:
    """Return, for each expected grasp, whether a found grasp is the same within `config`.

    The gripper is symmetric: a grasp turned by 180 degrees about its approach axis is the same.
    """
    shift = np.linalg.norm(found.translation[:, None] - expected.translation, axis=2)
    wider = np.abs(found.width[:, None] - expected.width)
    half_turn = np.diag([1.0, -1.0, -1.0])
    turn = np.minimum(
        _angles(found.rotation, expected.rotation),
        _angles(found.rotation @ half_turn, expected.rotation),
    )
    same = (shift <= config.max_shift) & (wider <= config.max_shift) & (turn <= config.max_turn)
    return np.asarray(same.any(axis=0))


def _angles(one: Array, other: Array) -> Array:
    """Return the angles (n, m) in radians between rotations (n, 3, 3) and (m, 3, 3)."""
    cosine = (np.einsum("nij,mij->nm", one, other) - 1) / 2
    return np.asarray(np.arccos(np.clip(cosine, -1, 1)))
