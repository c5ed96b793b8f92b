"""Instance masks and workspace that users draw on their images."""

from collections.abc import Container

import numpy as np
from numpy.typing import NDArray

from pipelines.array_types import Mask
from pipelines.frames.masks import read_masks
from pipelines.frames.rgbd import Frame
from pipelines.frames.workspace_files import read_workspace_mask
from pipelines.inference.runs.run_settings import InferPaths


def drawn_by_user(
    paths: InferPaths, name: str, frame: Frame, shared: Container[str]
) -> tuple[NDArray[np.int32] | None, Mask | None]:
    """Return instance masks and workspace (H, W), which users draw on the images as taken.

    `shared`: last parts of names that several frames share.

    Raises:
        SymgraspError: the frame has no mask, or the sides of a mask have another ratio than those
            of the depth.
    """
    shape = frame.depth.shape
    masks = None if paths.masks is None else read_masks(paths.masks, name, shape, shared)
    workspace = None if paths.workspace is None else read_workspace_mask(paths.workspace, shape)
    return (
        None if masks is None else frame.undistorted(masks),
        None if workspace is None else frame.undistorted(workspace),
    )
