"""Grasp detection in frames held in memory, with models that are loaded once."""

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pipelines.configs import InferConfig, check_settings
from pipelines.configs.presets import preset_settings
from pipelines.configs.settings import changed
from pipelines.configs.stages import as_config, default_settings
from pipelines.configs.toml_files import read_toml
from pipelines.errors import SymgraspError, ValueRangeError
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.grasping.gripper import Gripper
from pipelines.grasping.limits import check_limits
from pipelines.inference.runs.run_settings import InferPaths, RunSettings, check_config
from symgrasp.frame_input import IntrinsicsLike, frame_of, instance_masks, workspace_of
from symgrasp.grasps import Grasps, ordered_grasps

if TYPE_CHECKING:
    import torch

OPTION = re.compile(r"(?<!\S)--([a-z-]+)")


class GraspDetector:
    """Finds grasps in RGB-D frames, with models that are loaded once.

    A frame always gives the same grasps, equal to those of `symgrasp infer`. Several threads may
    call one detector at the same time. Each call with a network uses one core: torch, OpenCV and
    numpy's matrix products are limited to it while any such call runs.
    """

    def __init__(
        self,
        gripper: str | Path | Gripper | None = None,
        *,
        preset: str | None = None,
        device: "str | torch.device" = "auto",
        settings: Mapping[str, object] | Path | str | InferConfig | None = None,
        detector: Path | str | None = None,
        network: Path | str | None = None,
        axis_critic: Path | str | None = None,
        plane_critic: Path | str | None = None,
        grasp_critic: Path | str | None = None,
        seed: int = 0,
    ) -> None:
        """Load the models.

        Args:
            gripper: preset (`rg2`, `franka`, `robotiq_2f85`), TOML file or `Gripper`; None for
                the gripper of `settings`.
            preset: `paper` for the method as printed; `settings` override it.
            device: `cpu`, `cuda`, `cuda:N`, `auto` (a GPU if there is one), or a `torch.device`.
            settings: settings of `symgrasp infer` that differ from the defaults, by dotted name, as
                `{"selection.feasibility.min_width": 0.004}`; or a TOML file as `symgrasp config
                infer` prints.
            detector: weights of the region detector; here and below, None selects the weights that
                come with symgrasp.
            network: weights of the grasp network.
            axis_critic: weights of the critic of axes and spheres.
            plane_critic: weights of the plane critic.
            grasp_critic: weights of the grasp critic.
            seed: seed of the random numbers, which restart with each frame.

        Raises:
            SymgraspError: a gripper, device or setting is unknown, the value of a setting is
                invalid, or weights are missing.
        """
        config = _infer_config(settings, preset)
        self.gripper, name = _gripper(gripper, config.gripper)
        self.settings = replace(config, gripper=name)
        weights = {
            "detector": detector,
            "network": network,
            "axis_critic": axis_critic,
            "plane_critic": plane_critic,
            "grasp_critic": grasp_critic,
        }
        paths = InferPaths(Path(), Path()).with_weights(
            **{name: _weights_file(name, path) for name, path in weights.items()}
        )
        seed = _whole_number(seed)
        self._run_settings = RunSettings(paths, self.settings, seed, str(device), timings=False)
        self._run_settings.warn_of_unused_weights()
        with _argument_names():
            check_config(self.settings)
            self._planner = replace(self._run_settings.planner(), gripper=self.gripper)

    def __call__(
        self,
        color: ArrayLike,
        depth: ArrayLike,
        intrinsics: IntrinsicsLike,
        *,
        masks: ArrayLike | None = None,
        workspace: ArrayLike | None = None,
        depth_units_per_metre: float | None = None,
    ) -> Grasps:
        """Return the grasps of a frame, best first.

        Args:
            color: (H, W, 3) uint8 RGB, registered to the depth.
            depth: (H, W) floats, metres along the optical axis, or whole numbers, millimetres;
                0, negative, nan and infinity are missing, and 65535 among whole numbers.
            intrinsics: of the depth image: fx, fy, cx, cy in pixels, a (3, 3) camera matrix or its
                nine numbers by rows, or a mapping with the keys of a camera file.
            masks: masks of the objects to grasp, in place of detected regions: (H, W) ids, 0 =
                background, or (H, W) or (n, H, W) bool. A pixel of several masks belongs to the
                first. Masks are of the images as given, with their lens distortion if any.
            workspace: where grasps may be: (H, W) bool, or a box x0, y0, z0, x1, y1, z1 in metres,
                in the frame that the setting `limits.box_frame` names.
            depth_units_per_metre: divisor that turns `depth` into metres; by default 1 for floats,
                and for whole numbers that of the camera file in `intrinsics`, else 1000.

        Raises:
            SymgraspError: an argument is invalid; the message names the argument and the reason.
        """
        result = self.frame_result(
            color,
            depth,
            intrinsics,
            masks=masks,
            workspace=workspace,
            depth_units_per_metre=depth_units_per_metre,
        )
        return ordered_grasps(result, self.gripper)

    def frame_result(
        self,
        color: ArrayLike,
        depth: ArrayLike,
        intrinsics: IntrinsicsLike,
        *,
        masks: ArrayLike | None = None,
        workspace: ArrayLike | None = None,
        depth_units_per_metre: float | None = None,
    ) -> FrameResult:
        """Return regions and grasps as in `grasps.h5`; arguments and errors as of `__call__`."""
        with _argument_names():
            frame = frame_of(color, depth, intrinsics, depth_units_per_metre)
            instances = instance_masks(masks, frame.depth.shape)
            mask, box = workspace_of(workspace, frame.depth.shape)
            planner = self._planner
            if box:
                limits = replace(self.settings.limits, box=box)
                check_limits(limits)
                planner = replace(planner, config=replace(self.settings, limits=limits))
        rng = np.random.default_rng(self._run_settings.seed)
        with self._run_settings.one_core():
            labels = None if instances is None else frame.undistorted(instances.labels)
            allowed = None if mask is None else frame.undistorted(mask)
            result = planner.plan(frame, rng, labels, allowed)
        return result if instances is None else _numbered(result, instances.first)


def _numbered(result: FrameResult, first: int) -> FrameResult:
    """Return `result` with the caller's numbers of instances, of which label 1 has `first`."""
    labels = result.regions.instance
    instance = np.where(labels > 0, labels - 1 + first, -1)
    return replace(result, regions=replace(result.regions, instance=instance))


def _gripper(gripper: object, default: str) -> tuple[Gripper, str]:
    """Return the gripper, and its preset or file; the default's where a `Gripper` is given."""
    if isinstance(gripper, Gripper):
        return gripper, InferConfig.gripper
    if not isinstance(gripper, str | Path | None):
        expected = "a preset, a TOML file, or a Gripper"
        raise ValueRangeError("gripper", f"a {type(gripper).__name__}", expected)
    name = default if gripper is None else str(gripper)
    return load_gripper(name), name


def _weights_file(name: str, path: object) -> Path | None:
    if not isinstance(path, str | os.PathLike | None):
        raise ValueRangeError(name, repr(path), "a file of weights")
    return None if path is None else Path(path)


def _whole_number(seed: object) -> int:
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
        raise ValueRangeError("seed", repr(seed), "a whole number, at least 0")
    return int(seed)


@contextmanager
def _argument_names() -> Iterator[None]:
    """Name options of the command in errors as Python arguments: `device`, not `--device`."""
    try:
        yield
    except SymgraspError as error:
        if error.arguments is None:
            raise
        named = [_named(each) if isinstance(each, str) else each for each in error.arguments]
        raise type(error)(*named) from error


def _named(text: str) -> str:
    return OPTION.sub(lambda found: found[1].replace("-", "_"), text)


def _infer_config(
    settings: Mapping[str, object] | Path | str | InferConfig | None, preset: str | None
) -> InferConfig:
    if isinstance(settings, InferConfig):
        check_settings(settings)
        if preset is not None:
            raise ValueRangeError("preset", preset, "left out where settings is an InferConfig")
        return settings
    config = default_settings("infer")
    if preset is not None:
        config = changed(config, preset_settings(str(preset), "infer"))
    if settings is None or isinstance(settings, Mapping):
        return changed(as_config(InferConfig, config), settings or {})
    try:
        path = Path(settings)
    except TypeError:
        expected = "a mapping of names to values, a TOML file, or an InferConfig"
        raise ValueRangeError("settings", repr(settings), expected) from None
    return as_config(InferConfig, changed(config, read_toml(path), f"{path}: "))
