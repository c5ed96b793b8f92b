"""Train a compared method from its prepared frames alone, on a GPU that has no dataset.

    python -m tools.gpu_training.train_peer NAME NAME.frames OUT.safetensors [options]

NAME.frames is the folder that `symgrasp train-baseline NAME ROOT` prepares. Weights, checkpoint and
curves are as of that command, except that their stamp names the frames, not the root.
"""

import argparse
import sys
import time
from dataclasses import asdict
from pathlib import Path

import torch

from pipelines.configs import TrainBaselineConfig
from pipelines.configs.settings import changed_by_text
from pipelines.dataset.training.region_frames import split_frames
from pipelines.errors import errors_as_sentences
from pipelines.learning.loop.loop import TrainingRun
from pipelines.learning.loop.runs import RunRequest, find_progress
from pipelines.learning.peers.peer import PeerTraining, count_peer_frames
from pipelines.learning.peers.registry import trained_peer
from pipelines.learning.speed.processes import Processes
from pipelines.network import sampling
from pipelines.network.devices import find_device
from pipelines.network.peers.trained import PEER_NETWORKS
from pipelines.network.weights_files import weights_metadata
from pipelines.storage.provenance import digest_folder, make_stamp
from tools.gpu_training.scenes_on_device import GraspNetOnDevice

STAGE = "train-baseline"
OWN: dict[str, type[PeerTraining]] = {"graspnet": GraspNetOnDevice}


def train_on_frames(
    name: str, frames: Path, output: Path, config: TrainBaselineConfig, request: RunRequest
) -> str:
    """Train on the prepared `frames`; return a line on the progress."""
    started = time.monotonic()
    device = find_device(request.device)
    if device.type == "cuda":
        from tools.gpu_training.farthest_points import sample_farthest  # noqa: PLC0415 - Triton

        sampling._farthest_points.plain = sample_farthest
    method = OWN.get(name) or trained_peer(name)
    config = config.with_schedule(method.peer.schedule)
    inputs = {"frames": digest_folder(frames, "*.h5")}
    stamp = make_stamp(STAGE, {"method": name, **asdict(config)}, seed=request.seed, inputs=inputs)
    earlier = find_progress(output, stamp, request)
    if earlier is not None and earlier.finished:
        return f"{output.name} is finished: skipped"
    sets = split_frames(frames.glob("*.h5"), count_peer_frames, config.val_fraction, request.seed)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(request.seed)
        trainee = method(sets, config, device, Processes())
    metadata = weights_metadata(PEER_NETWORKS[name][0], config.network)
    run = TrainingRun(trainee, config, request, output, stamp, metadata)
    return str(run.report(started, resumes=earlier is not None))


@errors_as_sentences()
def main() -> None:
    """Read the options and train."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name")
    parser.add_argument("frames", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="settings")
    parser.add_argument("--minutes", type=float)
    parser.add_argument("--loaders", type=int, default=0)
    parser.add_argument("--device", default="auto")
    options = parser.parse_args()
    config = TrainBaselineConfig()
    for text in options.settings:
        setting, _, value = text.partition("=")
        config = changed_by_text(config, setting, value)
    seconds = 60.0 * options.minutes if options.minutes else None
    request = RunRequest(
        device=options.device, threads=1, max_seconds=seconds, resume=True, loaders=options.loaders
    )
    sys.stdout.write(
        train_on_frames(options.name, options.frames, options.out, config, request) + "\n"
    )


if __name__ == "__main__":
    main()
