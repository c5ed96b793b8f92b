"""Make the demo's frames: `python docs/demo_frames.py` writes pipelines/weights/frames/.

Scenes of their own seed, so that no object of them was ever trained on; one view of each.
"""

import shutil
import tempfile
from pathlib import Path

from pipelines import synthesize
from pipelines.batch import BatchOptions
from pipelines.configs import LabelConfig, SynthesizeConfig
from pipelines.formats.files import write_image, write_json
from pipelines.formats.graspnet import GraspNetRoot

FOLDER = Path(__file__).parent.parent / "pipelines" / "weights" / "frames"
SEED = 2026
CONFIG = SynthesizeConfig(
    splits=("seen", "novel"),
    scenes_per_split=2,
    views=1,
    objects_per_pool=24,
    min_objects=6,
    max_objects=8,
    sensor="realsense",
    width=640,
    height=480,
    collision_labels=False,
    labels=LabelConfig(num_points=0),
)


def main() -> None:
    """Synthesize, and lay the frames out as flat files."""
    with tempfile.TemporaryDirectory() as folder:
        report = synthesize.run(Path(folder), CONFIG, BatchOptions(), seed=SEED)
        if report.failed:
            raise SystemExit(str(report.failed))
        root = GraspNetRoot(Path(folder))
        for number, scene in enumerate(root.scenes(), start=1):
            files = scene.frame(0)
            camera = root.read_frame(files).intrinsics
            stem = FOLDER / f"table_{number}"
            FOLDER.mkdir(parents=True, exist_ok=True)
            write_image(stem.with_name(f"{stem.name}_color.png"), root.read_frame(files).color)
            shutil.copyfile(files.path("depth"), stem.with_name(f"{stem.name}_depth.png"))
            fields = ("fx", "fy", "cx", "cy", "width", "height")
            content = {field: getattr(camera, field) for field in fields} | {"depth_scale": 1000}
            write_json(stem.with_name(f"{stem.name}_camera.json"), content)


if __name__ == "__main__":
    main()
