"""Draw the README's picture of `make demo`, docs/images/demo.jpg."""

import tempfile
from pathlib import Path

import cv2
import numpy as np

from pipelines import infer
from pipelines.configs import InferConfig
from pipelines.inference.models import WEIGHTS
from pipelines.runtime.batch import BatchOptions

PICTURE = Path(__file__).parents[1] / "docs" / "images" / "demo.jpg"
SIZE = (600, 450)  # pixels of each of the four frames
QUALITY = 85


def main() -> None:
    """Find grasps in the demo's frames, and arrange their overlays two by two."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = infer.InferPaths(WEIGHTS / "frames", folder / "grasps.h5", folder)
        report = infer.run(paths, InferConfig(), BatchOptions(progress=False))
        if report.failed:
            raise SystemExit(str(report.failed))
        drawn = [cv2.imread(str(folder / f"{each}.png")) for each in sorted(report.done)]
    small = [cv2.resize(each, SIZE, interpolation=cv2.INTER_AREA) for each in drawn]
    whole = np.vstack([np.hstack(small[:2]), np.hstack(small[2:])])
    cv2.imwrite(str(PICTURE), whole, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


if __name__ == "__main__":
    main()
