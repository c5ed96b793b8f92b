"""Train the grasp network on one GPU, on regions that the host's cores render at the same time."""

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

from pipelines.configs import EndlessConfig, TrainConfig
from pipelines.configs.presets import PRESETS, preset_settings
from pipelines.configs.settings import changed, changed_by_text
from pipelines.errors import ValueRangeError, counted, errors_as_sentences
from pipelines.learning.grasp_network.grasp_training import Sample, sample_loss
from pipelines.learning.loop.loop import CLIP_NORM, LOG_SECONDS
from pipelines.network import pointnet2, sampling
from pipelines.network.model import SymmetryGraspNet
from pipelines.network.training import augmentation
from pipelines.network.training.losses import NUM_ERROR_POINTS
from pipelines.network.training.region_batch import RegionBatch
from pipelines.network.weights_files import weights_metadata
from pipelines.storage.checkpoints import save_weights
from pipelines.train import build
from tools.gpu_training.rendering import RegionRing, Renderers
from tools.gpu_training.schedule import Schedule

FIRST_REGIONS = 1500  # regions before the first step


class GraphStep:
    """One step of the training, on a GPU as one CUDA graph, which never waits for the host."""

    def __init__(
        self,
        module: SymmetryGraspNet,
        sample: Sample,
        config: TrainConfig,
        rate: float,
        *,
        as_graph: bool = True,
    ) -> None:
        self.module, self.sample, self.config = module, sample, config
        self.device = sample.query.device
        on_gpu = self.device.type == "cuda"
        self.rate = torch.tensor(rate, device=self.device)
        self.averaged = torch.tensor(0.0, device=self.device)
        self.loss = torch.zeros((), device=self.device)
        self.parameters = list(module.parameters())
        self.optimizer = torch.optim.Adam(
            self.parameters, lr=self.rate, capturable=on_gpu, foreach=on_gpu
        )
        state = module.state_dict()
        self.names = [name for name, each in state.items() if each.is_floating_point()]
        self.live = [state[name] for name in self.names]
        self.mean = [each.detach().clone() for each in self.live]
        for parameter in self.parameters:
            parameter.grad = torch.zeros_like(parameter)
        self._graph = self._captured() if on_gpu and as_graph else None

    def run(self, sample: Sample, rate: float, averaged: float) -> None:
        """Learn from `sample`."""
        self.rate.fill_(rate)
        self.averaged.fill_(averaged)
        for name, tensor in self.sample.tensors().items():
            tensor.copy_(sample.tensors()[name])
        if self._graph is None:
            self._once()
        else:
            self._graph.replay()

    def _captured(self) -> torch.cuda.CUDAGraph:
        side, graph = torch.cuda.Stream(), torch.cuda.CUDAGraph()
        side.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(side):
            for _ in range(4):
                self._once()
        torch.cuda.current_stream().wait_stream(side)
        with torch.cuda.graph(graph, stream=side):  # with a separate workspace
            self._once()
        return graph

    def _once(self) -> None:
        self.optimizer.zero_grad(set_to_none=False)
        loss = sample_loss(self.module, self.sample, self.config, self.device)["total"]
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.parameters, CLIP_NORM)
        for parameter in self.parameters:  # non-finite gradients change nothing
            parameter.grad.nan_to_num_(0.0, 0.0, 0.0)
        self.optimizer.step()
        for mean, live in zip(self.mean, self.live, strict=True):
            mean.lerp_(live, 1.0 - self.averaged)
        self.loss.lerp_(torch.nan_to_num(loss.detach()), 0.02)

    def averaged_weights(self) -> dict[str, Tensor]:
        """Return the state with the mean of the weights."""
        state = {name: each.detach().cpu() for name, each in self.module.state_dict().items()}
        means = zip(self.names, self.mean, strict=True)
        return state | {name: each.detach().cpu() for name, each in means}


def prepare_layers(device: torch.device) -> None:
    """Make augmentation draw on `device`, and layers avoid operations that a graph cannot hold.

    On the CPU each region draws from its own generator; here all regions share one generator.
    """

    def rotations(vectors: Tensor) -> Tensor:
        angle = vectors.norm(dim=-1).clamp(min=1e-8)[:, None, None]
        x, y, z = (vectors / angle[:, 0]).unbind(-1)
        zero = torch.zeros_like(x)
        skew = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).view(-1, 3, 3)
        return torch.eye(3) + torch.sin(angle) * skew + (1.0 - torch.cos(angle)) * (skew @ skew)

    torch.set_default_device(device)
    augmentation._normal = lambda regions, *shape: torch.randn((len(regions), *shape))
    augmentation._uniform = lambda regions, count: torch.rand((len(regions), count))
    augmentation._rotations = rotations
    if device.type == "cuda":
        from tools.gpu_training.farthest_points import sample_farthest  # noqa: PLC0415 - Triton

        torch.backends.cuda.matmul.allow_tf32 = True
        sampling._farthest_points.plain = sample_farthest
        pointnet2.weighted_sum = gathered_sum  # type: ignore[attr-defined]


def gathered_sum(values: Tensor, index: Tensor, weight: Tensor) -> Tensor:
    """Return sums (B, M, C) of `values` at `index` (B, M, K), each times its `weight`."""
    return (sampling.gather(values, index) * weight[..., None]).sum(2)


def drawn_sample(ring: RegionRing, size: int, config: TrainConfig) -> Sample:
    """Return augmented regions of the ring and their scaled copies."""
    rows, count = torch.randint(len(ring), (size,)), config.network.num_points
    batch: RegionBatch = ring.batch(rows, config, config.augmentation.lost_table)
    initial = augmentation.augment(batch, config.augmentation, range(size))
    copies = augmentation.scaled_copy(initial, config.augmentation, range(size))
    query, measured = (
        torch.rand((size, count)).argsort(1)[:, :taken].contiguous()
        for taken in (config.num_loss_points, NUM_ERROR_POINTS)
    )
    return Sample(initial, copies, query, measured)


def first_regions(
    renderers: Renderers, capacity: int, device: torch.device, count: int = FIRST_REGIONS
) -> RegionRing:
    """Return a ring with `count` regions, at most half of its capacity, for the first steps.

    Raises:
        ValueRangeError: there is no room for the regions of two scenes.
        SymgraspError: no regions can be rendered.
    """
    least = 2 * EndlessConfig().regions_per_scene
    if capacity < least:
        expected = f"at least {least}, the regions of two scenes"
        raise ValueRangeError("number of regions on the device", capacity, expected)
    ring = RegionRing(capacity, device)
    while len(ring) < min(count, capacity // 2):
        ring.take_in(renderers, 64)
        time.sleep(0.05)
    return ring


def train_config(preset: str | None, settings: Sequence[str] = ()) -> TrainConfig:
    """Return the settings of `symgrasp train`, changed by `preset`, if given.

    `settings`: further changes, each NAME=VALUE.
    """
    config = changed(TrainConfig(), preset_settings(preset, "train") if preset else {})
    for name, _, value in (setting.partition("=") for setting in settings):
        config = changed_by_text(config, name, value)
    return config


def seconds_left(began: float, minutes: float) -> float:
    """Return the seconds that are left of `minutes` since `began`, on the monotonic clock.

    Raises:
        ValueRangeError: none are left, so that only untrained weights could be written.
    """
    passed = time.monotonic() - began
    if passed >= 60.0 * minutes:
        expected = f"more: the first regions took {passed:.0f} s, and no time is left for a step"
        raise ValueRangeError("--minutes", minutes, expected)
    return 60.0 * minutes - passed


def run_training(options: argparse.Namespace) -> None:
    """Train until the minutes are over, and write the mean of the weights."""
    device = torch.device(options.device)
    config = train_config(options.preset, options.set)
    renderers = Renderers(options.objects, options.seed, options.workers, options.limit)
    prepare_layers(device)
    torch.manual_seed(options.seed)
    module = build(config, options.seed, options.init).to(device).train()
    began, ring = time.monotonic(), first_regions(renderers, options.capacity, device)
    first = drawn_sample(ring, options.batch_size, config)
    step = GraphStep(module, first, config, options.rate, as_graph=options.graph)
    started, seconds = time.monotonic(), seconds_left(began, options.minutes)
    end = started + seconds
    schedule, steps = Schedule(options.rate, seconds, options.averaged, options.drops), 0
    reported = started
    while (now := time.monotonic()) < end and steps < options.max_steps:
        averaged = min(schedule.averaged, (steps + 1) / (steps + 11.0))
        if steps % 4 == 0:
            ring.take_in(renderers, 2)
        sample = drawn_sample(ring, options.batch_size, config)
        step.run(sample, schedule.rate_at(steps, now - started), averaged)
        steps += 1
        if now - reported > LOG_SECONDS:
            reported = now
            sys.stdout.write(
                f"step {steps}, {counted(ring.seen, 'region')}, loss {float(step.loss):.3f}\n"
            )
            sys.stdout.flush()
    renderers.end()
    metadata = weights_metadata(SymmetryGraspNet.__name__, config.network)
    metadata |= {"steps": str(steps), "batch_size": str(options.batch_size)}
    save_weights(options.out, step.averaged_weights(), metadata)


@errors_as_sentences()
def main() -> None:
    """Read the options and train."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--objects", type=Path, required=True, help="written by labelled_objects")
    parser.add_argument("--out", type=Path, required=True, help="weights to write")
    parser.add_argument("--init", type=Path, help="weights to start from")
    parser.add_argument("--preset", choices=PRESETS, help="settings of `symgrasp train --preset`")
    parser.add_argument("--set", action="append", default=[], help="a setting of `symgrasp train`")
    parser.add_argument("--drops", type=int, default=0, help="drops of the rate, not a cosine")
    parser.add_argument("--graph", action=argparse.BooleanOptionalAction, default=True)
    parser.add_argument("--minutes", type=float, default=9.0, help="including the first rendering")
    parser.add_argument("--max-steps", type=int, default=10**9)
    parser.add_argument("--batch-size", type=int, default=64)
    parser.add_argument("--rate", type=float, default=0.0013, help="largest learning rate")
    parser.add_argument(
        "--averaged", type=float, default=0.9996, help="share of the mean kept per step"
    )
    parser.add_argument("--workers", type=int, default=15, help="processes that render")
    parser.add_argument("--limit", type=int, help="number of first objects to use")
    parser.add_argument("--capacity", type=int, default=300_000, help="regions on the device")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cuda")
    run_training(parser.parse_args())


if __name__ == "__main__":
    main()
