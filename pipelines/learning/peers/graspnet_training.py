"""GraspNet's baseline as a `Trainee`: clouds, and candidates that hold at labelled points."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from pipelines.configs.peers import PeerSchedule
from pipelines.learning.peers.graspnet_clouds import LabelledScene, labelled_scene
from pipelines.learning.peers.graspnet_labels import graspnet_frame_arrays
from pipelines.learning.peers.peer import Drawn, Peer, PeerTraining, mean_figures
from pipelines.network.peers.graspnet import (
    DEPTHS,
    GRASPNET_SIZES,
    NUM_TURNS,
    GraspNetBaseline,
    Seeds,
)

OPERATION_WEIGHT = 0.2  # weight of the losses of operations and tolerances
LEAST_VALUE = 0.1  # least value of a label that operations are learned from
MOST_TURN = np.radians(30.0)  # about the table's normal, either way


class _Losses(GraspNetBaseline):
    """The network with its loss terms as its output."""

    def forward(self, cloud: LabelledScene) -> dict[str, Tensor]:
        """Return the loss terms of one cloud."""
        points = cloud.points[None]
        seeds, _ = self.seeds(points)
        nearest = torch.cdist(seeds.points[0], cloud.places).argmin(dim=1)
        on_object = cloud.on_object[seeds.index[0]]
        top = seeds.views[0].detach().argmax(dim=1)
        origin, rotation = cloud.places[nearest][None], cloud.turns[nearest, top][None]
        predicted = self.operations(points, origin, rotation)
        rows = nearest, top
        value, width, tolerance = (
            each[rows].view(-1, NUM_TURNS, DEPTHS).transpose(1, 2)
            for each in (cloud.value, cloud.width, cloud.tolerance)
        )
        best = value.argmax(dim=2, keepdim=True)  # (S, 4, 1) the best angle
        held = (value.gather(2, best)[..., 0] > LEAST_VALUE) & on_object[:, None]

        def term(found: Tensor, wanted: Tensor) -> Tensor:
            errors = functional.huber_loss(
                found[0].gather(2, best), wanted.gather(2, best), reduction="none"
            )
            return _mean_where(errors[..., 0], held)

        logits = functional.cross_entropy(
            predicted.angle[0].flatten(0, 1), best.flatten(), reduction="none"
        )
        return _view_terms(seeds, cloud, nearest, on_object) | {
            "score": term(predicted.score, value),
            "angle": _mean_where(logits.view(held.shape), held),
            "width": term(predicted.width, width),
            "tolerance": term(predicted.tolerance, tolerance),
        }


def _view_terms(
    seeds: Seeds, cloud: LabelledScene, nearest: Tensor, on_object: Tensor
) -> dict[str, Tensor]:
    wanted = cloud.value.amax(dim=2)[nearest]
    errors = (seeds.views[0] - wanted).square().mean(dim=1)
    return {
        "objectness": functional.cross_entropy(seeds.objectness[0], on_object.long()),
        "views": _mean_where(errors, on_object),
    }


def _mean_where(values: Tensor, chosen: Tensor) -> Tensor:
    """Return the mean of the `chosen` among `values`; 0 if none is chosen."""
    return (values * chosen).sum() / chosen.sum().clamp(min=1)


def mean_terms(
    module: nn.Module,
    clouds: Sequence[LabelledScene],
    device: torch.device,
    generator: torch.Generator | None = None,
) -> dict[str, Tensor]:
    """Return the mean loss terms of clouds, and their weighted sum as `total`."""
    each = [module(cloud.to(device)) for cloud in clouds]
    terms = {name: torch.stack([found[name] for found in each]).mean() for name in each[0]}
    operation = terms["score"] + terms["angle"] + terms["width"] + terms["tolerance"]
    total = terms["objectness"] + terms["views"] + OPERATION_WEIGHT * operation
    return {"total": total} | terms


class GraspNetTraining(PeerTraining):
    """A `Trainee`: GraspNet's baseline with its training frames and its validation frames."""

    peer = Peer(
        schedule=PeerSchedule(
            steps=4000, epoch_steps=250, batch_size=2, learning_rate=0.001, decay_steps=1500
        ),
        needs=("grasp_label", "collision_label"),
        labels="cell",
        build=_Losses,
        prepare=graspnet_frame_arrays,
        item=LabelledScene,
        terms=mean_terms,
        cpu_micro_batch=1,  # clouds
    )

    def examples(self, drawn: Drawn) -> list[LabelledScene]:
        """Return each frame, turned at random about the table's normal."""
        count = GRASPNET_SIZES[self.config.network.variant].input
        return [
            labelled_scene(frame, count, rng, rng.uniform(-MOST_TURN, MOST_TURN))
            for frame, rng in drawn
        ]

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Return the loss terms on the validation frames, unturned."""
        count = GRASPNET_SIZES[self.config.network.variant].input
        clouds = (
            labelled_scene(frame, count, np.random.default_rng(0), 0.0)
            for frame in self.validation_frames()
        )
        return mean_figures([mean_terms(self.module, [each], self.device) for each in clouds])
