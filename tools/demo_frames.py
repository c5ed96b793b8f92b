"""Make the demo's frames: `python tools/demo_frames.py` writes pipelines/weights/frames/.

The scenes have a separate seed, so that none of their objects is used in training; one view each.
"""

import tempfile
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from pipelines import synthesize
from pipelines.configs import LabelConfig, SynthesizeConfig
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.runtime.batch import BatchOptions
from pipelines.storage.files import write_json
from pipelines.storage.images import write_image

FOLDER = Path(__file__).parent.parent / "pipelines" / "weights" / "frames"
SEED = 2026
WIDTH, HEIGHT = 800, 600  # pixels of the kept window about the objects
CONFIG = SynthesizeConfig(
    splits=("seen", "novel"),
    scenes_per_split=2,
    views=1,
    objects_per_pool=24,
    min_objects=6,
    max_objects=8,
    sensor="realsense",
    width=1280,
    height=960,
    collision_labels=False,
    labels=LabelConfig(num_points=0),
)


def main() -> None:
    """Synthesize scenes and write their frames as flat files."""
    with tempfile.TemporaryDirectory() as folder:
        report = synthesize.run(Path(folder), CONFIG, BatchOptions(), seed=SEED)
        if report.failed:
            raise SystemExit(str(report.failed))
        root = GraspNetRoot(Path(folder))
        for number, scene in enumerate(root.scenes(), start=1):
            files = scene.frame(0)
            frame, label = root.read_frame(files), root.read_label(files)
            top, left = window_about(label > 0)
            view = np.s_[top : top + HEIGHT, left : left + WIDTH]
            intrinsics = frame.intrinsics
            camera = replace(
                intrinsics,
                cx=intrinsics.cx - left,
                cy=intrinsics.cy - top,
                width=WIDTH,
                height=HEIGHT,
            )
            write_image(FOLDER / f"table_{number}_color.png", frame.color[view])
            depth = np.rint(frame.depth[view] * 1000).astype(np.uint16)
            write_image(FOLDER / f"table_{number}_depth.png", depth)
            content = asdict(camera) | {"depth_scale": 1000}
            write_json(FOLDER / f"table_{number}_camera.json", content)


def window_about(mask: np.ndarray) -> tuple[int, int]:
    """Return top and left of the window about the middle of `mask`."""
    rows, columns = np.nonzero(mask)
    top, left = int(rows.mean()) - HEIGHT // 2, int(columns.mean()) - WIDTH // 2
    return min(max(top, 0), mask.shape[0] - HEIGHT), min(max(left, 0), mask.shape[1] - WIDTH)


if __name__ == "__main__":
    main()
