"""Compare losses of networks on the same regions, to see whether the loss of a training is flat.

The regions are rendered from the training objects, in scenes of a seed of their own. The mean of
a training's last steps depends on the regions drawn; the difference on the same regions does not.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from pipelines.configs.presets import PRESETS
from pipelines.errors import errors_as_sentences
from pipelines.learning.grasp_network.grasp_training import Sample, sample_loss
from pipelines.train import build
from tools.gpu_training.rendering import Renderers
from tools.gpu_training.train import drawn_sample, first_regions, prepare_layers
from tools.gpu_training.train_together import RowPlan, weights_path


@torch.no_grad()
def mean_loss(path: Path, plan: RowPlan, samples: Sequence[Sample]) -> float:
    """Return the mean loss over `samples` of the network with the weights at `path`.

    Raises:
        FormatError: these are of a network with other settings, as `build` says.
    """
    module = build(plan.config, 0, path).eval()
    cpu = torch.device("cpu")
    losses = [float(sample_loss(module, each, plan.config, cpu)["total"]) for each in samples]
    return sum(losses) / len(losses)


def compare_rows(options: argparse.Namespace) -> None:
    """Print one line for each network: its mean loss with the weights of each folder."""
    plans = [RowPlan.of(text, options.objects, options.preset) for text in options.row]
    prepare_layers(torch.device("cpu"))
    for path in dict.fromkeys(plan.objects for plan in plans):
        renderers = Renderers(path, options.scene_seed, options.workers)
        count = options.regions
        ring = first_regions(renderers, 2 * count, torch.device("cpu"), count)
        renderers.end()
        for plan in (each for each in plans if each.objects == path):
            torch.manual_seed(options.scene_seed)
            size = plan.config.batch_size
            samples = [drawn_sample(ring, size, plan.config) for _ in range(options.batches)]
            for seed in options.seeds:
                paths = [weights_path(folder, plan.name, seed) for folder in options.folders]
                losses = [round(mean_loss(path, plan, samples), 4) for path in paths]
                line = json.dumps({"network": f"{plan.name}_{seed}", "losses": losses})
                sys.stdout.write(f"{line}\n")
                sys.stdout.flush()


@errors_as_sentences()
def main() -> None:
    """Read the options and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+", help="folders of `train_together`")
    parser.add_argument("--objects", type=Path, required=True, help="written by labelled_objects")
    parser.add_argument(
        "--row", action="append", required=True, help="NAME[@OBJECTS][:SETTING=VALUE,...]"
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="seeds of each row")
    parser.add_argument("--preset", choices=PRESETS, help="settings of `symgrasp train --preset`")
    parser.add_argument("--batches", type=int, default=15, help="drawn batches of regions")
    parser.add_argument("--regions", type=int, default=1500, help="rendered regions to draw from")
    parser.add_argument("--scene-seed", type=int, default=10**8, help="seed of the scenes")
    parser.add_argument("--workers", type=int, default=1, help="processes that render")
    compare_rows(parser.parse_args())


if __name__ == "__main__":
    main()
