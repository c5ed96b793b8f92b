"""PointNetGPD as a `Trainee`: the points that labelled hands close on."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from pipelines.array_types import Indices, Mask
from pipelines.configs.peers import PeerNetworkConfig, PeerSchedule
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import FrameFiles
from pipelines.grasping.peers.hands import Hands, drawn_points
from pipelines.learning.peers.peer import Arrays, Drawn, Peer, PeerTraining, storable
from pipelines.learning.peers.pointnetgpd_labels import GOOD, labelled_hands
from pipelines.network.peers.pointnetgpd import HAND_POINTS, PointNetGPD

HANDS_A_FRAME = 16  # hands drawn for a step, half of them good
HALF_TURN = np.array([1.0, -1.0, -1.0], np.float32)  # about the approach axis: the same hand
UNITS = 10_000.0  # units per metre of stored points


@dataclass(frozen=True)
class HandCrops:
    """Points (B, N, 3) that hands close on, in their frames, and the classes (B,) of the hands."""

    points: Tensor
    kind: Tensor


def pointnetgpd_frame(
    root: GraspNetRoot, files: FrameFiles, config: PeerNetworkConfig | None = None
) -> Arrays:
    """Return the labelled hands of a frame and the points of its objects, camera frame.

    `rotation` (n, 3, 3), `origin` (n, 3) and `depth` (n,) metres, `kind` (n,); `objects` (m, 3)
    int16, tenths of a millimetre, without points too far to be stored.
    """
    found = labelled_hands(root, files)
    floats = {name: getattr(found.hands, name) for name in ("rotation", "origin", "depth")}
    arrays: Arrays = {name: each.astype(np.float32) for name, each in floats.items()}
    near = found.objects[storable(found.objects)]
    objects = np.round(near * UNITS).astype(np.int16)
    return arrays | {"kind": found.kind, "objects": objects}


def drawn_crops(frame: Arrays, num_points: int, rng: np.random.Generator) -> HandCrops:
    """Return the crops of `HANDS_A_FRAME` hands of a frame, half of them good if possible."""
    kind = frame["kind"]
    hands = Hands.equally_open(frame["rotation"], frame["origin"], frame["depth"])
    objects = frame["objects"] / UNITS
    clouds, chosen = [], _balanced(kind == GOOD, rng)
    for hand in chosen.tolist():
        points = drawn_points(hands.closing_region(hand, objects), num_points, rng)
        clouds.append(points * HALF_TURN if rng.random() < 0.5 else points)
    kinds = torch.from_numpy(kind[chosen].astype(np.int64))
    return HandCrops(torch.from_numpy(np.stack(clouds).astype(np.float32)), kinds)


def _balanced(is_good: Mask, rng: np.random.Generator) -> Indices:
    """Return the numbers of `HANDS_A_FRAME` hands, half of them good; some twice if few."""
    good, other = np.flatnonzero(is_good), np.flatnonzero(~is_good)
    halves = [each for each in (good, other) if len(each)]
    size = HANDS_A_FRAME // len(halves)
    return np.concatenate([rng.choice(each, size, replace=len(each) < size) for each in halves])


def joined_crops(crops: Sequence[HandCrops]) -> HandCrops:
    """Return several crops as one."""
    return HandCrops(
        torch.cat([each.points for each in crops]), torch.cat([each.kind for each in crops])
    )


def class_terms(
    module: nn.Module,
    crops: HandCrops,
    device: torch.device,
    generator: torch.Generator | None = None,
) -> dict[str, Tensor]:
    """Return the negative log-likelihood of the classes as `total`."""
    return {"total": class_loss(module, crops, device)[0]}


def class_loss(module: nn.Module, crops: HandCrops, device: torch.device) -> tuple[Tensor, Tensor]:
    """Return the mean negative log-likelihood, and the log-probabilities (B, 3)."""
    scores = module(crops.points.to(device))
    return nn.functional.nll_loss(scores, crops.kind.to(device)), scores


class PointNetGPDTraining(PeerTraining):
    """A `Trainee`: PointNetGPD with its training frames and its validation frames."""

    peer = Peer(
        schedule=PeerSchedule(
            steps=10_000, epoch_steps=500, batch_size=4, learning_rate=0.001, decay_steps=2500
        ),
        needs=("grasp_label", "collision_label"),
        labels="kind",
        build=PointNetGPD,
        prepare=pointnetgpd_frame,
        item=HandCrops,
        terms=class_terms,
        cpu_micro_batch=2,  # frames
    )

    @property
    def num_points(self) -> int:
        """Number of points of a hand that the network takes."""
        return HAND_POINTS[self.config.network.variant]

    def examples(self, drawn: Drawn) -> HandCrops:
        """Return the crops of some hands of each frame."""
        return joined_crops([drawn_crops(frame, self.num_points, rng) for frame, rng in drawn])

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Return loss, accuracy, and precision and recall of good hands on validation frames."""
        losses, found, true = [], [], []
        for number, frame in enumerate(self.validation_frames()):
            crops = drawn_crops(frame, self.num_points, np.random.default_rng(number))
            loss, scores = class_loss(self.module, crops, self.device)
            losses.append(float(loss))
            found.append(scores.argmax(dim=1).cpu().numpy())
            true.append(crops.kind.numpy())
        predicted, real = np.concatenate(found), np.concatenate(true)
        hits = float(((predicted == GOOD) & (real == GOOD)).sum())
        return {
            "loss": float(np.mean(losses)),
            "accuracy": float((predicted == real).mean()),
            "good_precision": hits / max(int((predicted == GOOD).sum()), 1),
            "good_recall": hits / max(int((real == GOOD).sum()), 1),
        }
