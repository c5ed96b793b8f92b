"""Make the manifest of the default weights: `python tools/golden_frame.py`.

Run it after every intended change of weights, demo frames or results of `infer`; `symgrasp doctor`
then compares other machines with this machine.
"""

from pathlib import Path

from pipelines.configs import InferConfig
from pipelines.health.golden import FRAMES, best_grasps, golden_result
from pipelines.inference import models
from pipelines.storage.provenance import digest, make_stamp
from pipelines.storage.weights_manifest import Manifest, manifest_path, write_manifest

FRAME = "table_1"


def make_manifest() -> tuple[Manifest, dict[str, str]]:
    """Return the manifest, and the digests of the weights and the golden frame's files."""
    files = {path.name: digest(path) for path in sorted(models.WEIGHTS.glob("*.safetensors"))}
    frame = {path.name: digest(path) for path in sorted(FRAMES.glob(f"{FRAME}_*"))}
    return Manifest(files, FRAME, best_grasps(golden_result(FRAME))), files | frame


def main(folder: Path = models.WEIGHTS) -> None:
    """Write the manifest into the folder of the weights."""
    manifest, inputs = make_manifest()
    stamp = make_stamp("golden-frame", InferConfig(), inputs=inputs)
    write_manifest(manifest_path(folder), manifest, stamp)


if __name__ == "__main__":
    main()
