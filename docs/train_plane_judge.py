"""Train the judge of mirror planes, `pipelines/weights/plane_judge.safetensors` (D. 80).

    python docs/train_plane_judge.py collect ROOT EVIDENCE.npz [STRIDE]
    python docs/train_plane_judge.py fit JUDGE.safetensors CALIBRATION.npz EVIDENCE.npz ...

`collect` runs the default detector and network on every STRIDE-th frame of ROOT, and writes what
each candidate plane makes of the region, and whether it is true. `fit` trains the judge on what
was collected of the training's objects, and makes log odds of what it says by CALIBRATION,
collected of objects that no network was trained on (docs/calibrate_trust.py says how such a ROOT is
made).
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from calibrate_trust import EVALUATE, INFER, SeenRegion, logistic, seen_regions
from torch import Tensor, nn
from torch.nn import functional

from pipelines.evaluation.truth import TruthReader
from pipelines.formats import plane_judge_file
from pipelines.formats.checkpoints import save_weights
from pipelines.formats.files import atomic_path
from pipelines.formats.graspnet import GraspNetRoot
from pipelines.geometry.symmetry import ReflectionSymmetry
from pipelines.geometry.symmetry_error import symmetry_error
from pipelines.grasping import grounding, mirror_views, plane_evidence
from pipelines.grasping.plane_evidence import RegionEvidence
from pipelines.grasping.plane_judge import PlaneJudge
from pipelines.metrics.symmetry_matching import TrueRegion, implied_symmetries, scored_symmetries

# Dense errors: a hit (Sec. IV), and half of it, since a finger needs more than a hit.
HIT_ERROR, PLANE_ERROR = 0.25, 0.134
ALIKE = 0.8  # cosine of normals, of planes whose error is worth a look
POINT_WIDTHS, PLANE_WIDTHS = (64, 64, 96), (64, 32, 1)
EPOCHS, BATCH, LEARNING_RATE, DECAY = 12, 256, 2e-3, 1e-2
DROPOUT = 0.2
POINTS_A_STEP = 96  # of 128: another view of the same plane each time
JITTER = 0.01  # decimetres
ACROSS = (2, 5)  # the point's and the normal's coordinate across: their sign means nothing

Rows = dict[str, np.ndarray]


class TrainedJudge(nn.Module):
    """`PlaneJudge` with gradients."""

    def __init__(self, mean: Tensor, spread: Tensor) -> None:
        super().__init__()
        first = mirror_views.POINT_FEATURES + mirror_views.PLANE_FEATURES
        joined = 2 * POINT_WIDTHS[-1] + len(mean) + mirror_views.PLANE_FEATURES
        self.point = layers(first, POINT_WIDTHS)
        self.plane = layers(joined, PLANE_WIDTHS)
        self.register_buffer("mean", mean)
        self.register_buffer("spread", spread)

    def forward(self, points: Tensor, planes: Tensor, evidence: Tensor) -> Tensor:
        """Return logits (k,) of points (k, n, 14), planes (k, 3) and evidence (k, e)."""
        around = planes[:, None].expand(-1, points.shape[1], -1)
        hidden = torch.cat([points, around], -1)
        for index, layer in enumerate(self.point):
            hidden = layer(torch.relu(hidden) if index else hidden)
        known = (evidence - self.mean) / self.spread
        joined = torch.cat([hidden.amax(1), hidden.mean(1), known, planes], -1)
        for index, layer in enumerate(self.plane):
            joined = layer(torch.relu(joined) if index else joined)
            if index == 0:
                joined = functional.dropout(joined, DROPOUT, self.training)
        return joined[:, 0]


def layers(width: int, widths: tuple[int, ...]) -> nn.ModuleList:
    """Return linear layers from `width` through `widths`."""
    sizes = zip((width, *widths), widths, strict=False)
    return nn.ModuleList(nn.Linear(*size) for size in sizes)


def plane_truth(plane: ReflectionSymmetry, region: TrueRegion) -> bool | None:
    """Return whether `plane` is listed; None where it is near one or follows from what is listed.

    Planes near one are hits, but not what a finger needs.
    """
    listed = scored_symmetries(region, "reflection")
    near = [s for s in listed if abs(float(plane.normal @ s.direction)) > ALIKE]
    error = min((symmetry_error(region.points, plane, s) for s in near), default=np.inf)
    if error <= PLANE_ERROR:
        return True
    follows = implied_symmetries(plane, region.symmetries)
    implied = any(symmetry_error(region.points, plane, s) <= HIT_ERROR for s in follows)
    return None if implied or error <= HIT_ERROR else False


def evidence_of(region: SeenRegion) -> RegionEvidence:
    """Return what the planes of a region are judged by."""
    axis, _ = region.axis_and_sphere()
    cloud, step = region.cloud, max(1, len(region.cloud) // grounding.NUM_POINTS)
    seen = cloud.points[::step], cloud.normals[::step], cloud.mask
    return RegionEvidence(region.slots, axis.symmetry.direction, *seen, region.scene)


def collected(root: Path, stride: int) -> Iterator[Rows]:
    """Yield, for each region, what its candidate planes are judged by and their truth."""
    reader = TruthReader(GraspNetRoot(root), EVALUATE)
    frames = [files for scene in reader.root.scenes() for files in scene.frames()]
    for files in frames[::stride]:
        for region in seen_regions(reader, files):
            known = evidence_of(region)
            planes = plane_evidence.fitted_planes(known)
            images = mirror_views.MirrorImages.of(planes, known.points, known.normals)
            verdicts = [plane_truth(plane, region.truth) for plane in planes]
            evidence = plane_evidence.plane_features(planes, images, known, INFER.selection)
            yield {
                "points": mirror_views.point_rows(planes, images, known.mask, known.scene),
                "planes": mirror_views.plane_rows(planes, known.points, known.scene),
                "evidence": evidence.astype(np.float32),
                "truth": np.array(
                    [-1 if verdict is None else int(verdict) for verdict in verdicts]
                ),
            }


def collect(root: Path, output: Path, stride: int) -> None:
    """Write the rows of all regions of `root`."""
    regions = list(collected(root, stride))
    rows = {name: np.concatenate([each[name] for each in regions]) for name in regions[0]}
    rows["points"] = rows["points"].astype(np.float16)
    with atomic_path(output) as temporary, temporary.open("wb") as stream:
        np.savez(stream, **rows)
    sys.stdout.write(f"{len(rows['truth'])} planes of {len(regions)} regions\n")


def read(path: Path) -> Rows:
    """Return the rows whose truth is known."""
    with np.load(path, allow_pickle=False) as arrays:
        rows = {name: arrays[name] for name in arrays.files}
    known = rows["truth"] >= 0
    return {name: array[known] for name, array in rows.items()}


def trained(rows: Rows, seed: int) -> TrainedJudge:
    """Return the network after `EPOCHS` passes over `rows`."""
    torch.manual_seed(seed)
    rng, count = np.random.default_rng(seed), len(rows["truth"])
    evidence = torch.from_numpy(rows["evidence"])
    judge = TrainedJudge(evidence.mean(0), evidence.std(0) + 1e-6)
    optimizer = torch.optim.AdamW(judge.parameters(), LEARNING_RATE, weight_decay=DECAY)
    steps = EPOCHS * (count // BATCH)
    rate = torch.optim.lr_scheduler.OneCycleLR(optimizer, LEARNING_RATE, steps)
    for epoch in range(EPOCHS):
        order, losses = rng.permutation(count), []
        for start in range(0, count - BATCH + 1, BATCH):
            chosen = np.sort(order[start : start + BATCH])
            points = torch.from_numpy(rows["points"][chosen].astype(np.float32))
            planes = torch.from_numpy(rows["planes"][chosen])
            truth = torch.from_numpy(rows["truth"][chosen]).float()
            logits = judge(varied(points), planes, evidence[chosen])
            loss = functional.binary_cross_entropy_with_logits(logits, truth)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            rate.step()
            losses.append(float(loss.detach()))
        sys.stdout.write(f"epoch {epoch + 1}: loss {np.mean(losses):.3f}\n")
    return judge.eval()


def varied(points: Tensor) -> Tensor:
    """Return some of the points, jittered, in either handedness."""
    chosen = points[:, torch.randperm(points.shape[1])[:POINTS_A_STEP]]
    sign = torch.where(torch.rand(len(points), 1) < 0.5, -1.0, 1.0)
    for column in ACROSS:
        chosen[..., column] *= sign
    chosen[..., :3] += JITTER * torch.randn_like(chosen[..., :3])
    return chosen


def fit(output: Path, calibration: Path, evidence: list[Path]) -> None:
    """Train on `evidence`, make log odds of the outcome by `calibration`, write all of it."""
    parts = [read(path) for path in evidence]
    rows = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    judge, held = trained(rows, 0), read(calibration)
    arrays = {name: tensor.numpy() for name, tensor in judge.state_dict().items()}
    plain = PlaneJudge.of(arrays | {"calibration": np.float32([0.0, 1.0])})
    logits = plain.logits(held["points"].astype(np.float32), held["planes"], held["evidence"])
    rows = np.stack([np.ones(len(logits)), logits], 1)
    weights = logistic(rows, held["truth"].astype(np.float64))
    sys.stdout.write(f"calibration {weights.round(2).tolist()} on {len(logits)} planes\n")
    arrays["calibration"] = weights.astype(np.float32)
    tensors = {name: torch.from_numpy(array) for name, array in arrays.items()}
    save_weights(output, tensors, {"model": plane_judge_file.MODEL})


def main() -> None:
    """Collect or fit, as the command line says."""
    command, *arguments = sys.argv[1:]
    if command == "collect":
        root, output, *stride = arguments
        collect(Path(root), Path(output), int(stride[0]) if stride else 1)
    else:
        output, calibration, *evidence = (Path(argument) for argument in arguments)
        fit(output, calibration, evidence)


if __name__ == "__main__":
    main()
