"""Grasps of other methods on the same frames, one row of the report each: `--with NAME.h5`."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from pipelines.configs.inference import TRAINED_METHODS
from pipelines.contents import mapping_in
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import SceneFiles
from pipelines.errors import FormatError, ValueRangeError, printable
from pipelines.evaluation.frames_read import note_of_gone_frames, refuse_another_dataset
from pipelines.evaluation.predictions import FramePredictions
from pipelines.evaluation.reports.reports import WITH
from pipelines.evaluation.rows import (
    AS_PRINTED,
    BASELINE_ROWS,
    BY_FITTING,
    OURS,
    SELECTED,
    report_row,
)
from pipelines.evaluation.truth_inputs import truth_digests
from pipelines.grasp_files.grasps_stream import (
    GraspsIndex,
    places_by_scene,
    read_dataset_frames,
    read_index,
)
from pipelines.grasp_files.gripper_files import gripper_digest, gripper_to_use, is_found_for
from pipelines.runtime.batch import BatchOptions, WorkItem, drop_stale
from pipelines.storage.provenance import Stamp, digest

RowPlaces = dict[str, tuple[Path, list[int]]]
COMPARED_METHODS = (*TRAINED_METHODS, BY_FITTING)  # of `infer --method`


@dataclass(frozen=True)
class ComparedRuns:
    """Grasps on the frames of a dataset by row: ours, and the grasps of `--with`."""

    root: GraspNetRoot
    index: GraspsIndex  # of our `grasps.h5`
    paths: Mapping[str, Path]  # row -> grasps.h5; another file's row has its printable name
    scenes: Mapping[SceneFiles, RowPlaces]  # places of the frames of each scene, by row

    @classmethod
    def of(cls, grasps: Path, others: Sequence[Path], dataset: Path) -> "ComparedRuns":
        """Return our file `grasps` and the files `others`, all on frames of `dataset`.

        Raises:
            ValueRangeError: two rows would have one name.
            FormatError: a file holds no frames, frames of another dataset, a frame twice, or other
                frames than our file.
        """
        root, index = GraspNetRoot.finished(dataset), read_index(grasps)
        paths = {OURS: grasps}
        for path in others:
            row = printable(path.stem)
            if row in (*paths, *BASELINE_ROWS):
                expected = f"another file name: {row} is the name of another row"
                raise ValueRangeError("--with", path, expected)
            _refuse_misnamed(path)
            paths[row] = path
        return cls(root, index, paths, _scenes(paths, root))

    def gripper(self, wanted: str) -> str:
        """Return the gripper of the trials: `wanted`, else the gripper of our grasps.

        Raises:
            FormatError: no gripper is wanted, and a file has grasps for another one than ours.
        """
        used = gripper_to_use(wanted, self.index.gripper, self.index.stamp)
        for row, theirs in self._for_other_grippers(used).items() if not wanted else ():
            expected = "run this command on it alone and use `compare`, or name a --gripper for all"
            raise FormatError(
                self.paths[row], f"has grasps for {theirs}, ours are for {used}", expected
            )
        return used

    def method_notes(self) -> dict[str, str]:
        """Return a sentence, if our file has the grasps of a compared method."""
        method = self.index.attrs["config"].get("method")
        if method not in COMPARED_METHODS:
            return {}
        note = (
            f"its grasps are those of `infer --method {method}`, and the report calls its row "
            f"{report_row(OURS).title}; --with shows them beside ours under their name"
        )
        return {f"method of {OURS}": note}

    def frames_notes(self) -> dict[str, str]:
        """Return a note for each row whose frames are gone and differ from ours."""
        found = {
            f"frames of {row}": note_of_gone_frames(path, read_index(path), self.root)
            for row, path in self.paths.items()
        }
        return {name: note for name, note in found.items() if note}

    def gripper_notes(self, gripper: str) -> dict[str, str]:
        """Return a sentence for each row with grasps for another gripper."""
        found = "the grasps were found for {} and are evaluated with {}"
        return {
            f"gripper of {row}": found.format(theirs, gripper)
            for row, theirs in self._for_other_grippers(gripper).items()
        }

    def _for_other_grippers(self, gripper: str) -> dict[str, str]:
        """Return the gripper of each row whose grasps were not found for `gripper`."""
        found = {row: read_index(path) for row, path in self.paths.items()}
        return {
            row: index.gripper if index.gripper != gripper else f"another {gripper}"
            for row, index in found.items()
            if not is_found_for(gripper, index.gripper, index.stamp)
        }

    def inputs(self, gripper: str, *, baselines: bool) -> dict[str, str]:
        """Return the digests of the grasps, the gripper and the truth."""
        inputs = {"grasps": digest(self.paths[OURS]), "gripper": gripper_digest(gripper)}
        inputs |= {f"{WITH}{row}": digest(path) for row, path in self.paths.items() if row != OURS}
        return inputs | truth_digests(self.root, self.scenes, baselines=baselines)

    def items(self, folder: Path, stamp: Stamp, options: BatchOptions) -> list[WorkItem]:
        """Return one item per scene and camera, with the places of its frames; drop stale ones."""
        items = [
            WorkItem(scene.name, folder / f"{scene.name}.json", stamp, (places,))
            for scene, places in self.scenes.items()
        ]
        drop_stale(items, options, folder.glob("[!.]*.json"))
        return items


def _refuse_misnamed(path: Path) -> None:
    """Raise ValueRangeError if the file has the name of a method that did not find its grasps."""
    name = path.stem.removesuffix(SELECTED)
    config = read_index(path).attrs["config"]
    if name in COMPARED_METHODS:
        fits, command = config.get("method") == name, f"infer --method {name}"
    elif name == AS_PRINTED:
        ranking = mapping_in(mapping_in(config, "selection"), "ranking")
        fits, command = ranking.get("by") == "eq8", "infer --preset paper"
    else:
        return
    if not fits:
        expected = f"another file name: {path.stem} is the row of grasps by `{command}`"
        raise ValueRangeError("--with", path, expected)


def _scenes(paths: Mapping[str, Path], root: GraspNetRoot) -> dict[SceneFiles, RowPlaces]:
    """Return the places of the frames of each scene, by row; errors as in `ComparedRuns.of`."""
    found: dict[SceneFiles, RowPlaces] = {}
    ours: dict[SceneFiles, list[str]] = {}
    for row, path in paths.items():
        index = read_index(path)
        names = index.dataset_names(path)
        scenes = places_by_scene(path, index, root)
        refuse_another_dataset(path, index, [each[0] for each in scenes.values()], root)
        theirs = {scene: [names[place] for place in each] for scene, each in scenes.items()}
        if row == OURS:
            found, ours = {scene: {} for scene in scenes}, theirs
            _refuse_doubles(path, list(chain.from_iterable(theirs.values())))
        for scene in {**ours, **theirs}:
            there, expected = theirs.get(scene, []), ours.get(scene, [])
            if there != expected:
                raise FormatError(path, _difference(there, expected), "run infer on all")
        for scene, rows in found.items():
            rows[row] = path, scenes[scene]
    return found


def _refuse_doubles(path: Path, names: Sequence[str]) -> None:
    """Raise FormatError if two frames of the file are one frame of the dataset."""
    doubles = [name for name, count in Counter(names).items() if count > 1]
    if doubles:
        found = f"holds the frame {doubles[0]} twice"
        raise FormatError(path, found, "run infer on one dataset alone, and name each frame once")


def frames_by_row(places: RowPlaces) -> Iterator[dict[str, FramePredictions]]:
    """Yield the predictions of all rows for each frame of a scene."""
    rows = (_predictions(*each) for each in places.values())
    for predictions in zip(*rows, strict=True):
        yield dict(zip(places, predictions, strict=True))


def _predictions(path: Path, places: list[int]) -> Iterator[FramePredictions]:
    knows_regions = read_index(path).knows_regions
    for result in read_dataset_frames(path, places):
        yield FramePredictions.from_result(result, knows_regions=knows_regions)


def _difference(names: Sequence[str], expected: Sequence[str]) -> str:
    missing = sorted(set(expected) - set(names))
    if missing:
        return f"lacks {len(missing)} of our frames, for example {missing[0]}"
    more = sorted(set(names) - set(expected))
    if more:
        return f"has frames that ours lacks, for example {more[0]}"
    return "has our frames in another order, or some of them twice"
