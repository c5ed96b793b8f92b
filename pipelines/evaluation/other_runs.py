"""Grasps of other methods on the same frames, a row of the report each: `--with NAME.h5`."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.graspnet.graspnet_layout import SceneFiles
from pipelines.errors import FormatError, ValueRangeError
from pipelines.evaluation.rows import BASELINE_ROWS, OURS
from pipelines.grasp_files.grasps_stream import places_by_scene, read_dataset_frames, read_index
from pipelines.grasp_files.grasps_tables import FrameResult

RowPlaces = dict[str, tuple[Path, list[int]]]


@dataclass(frozen=True)
class ComparedRuns:
    """Files of grasps by row: ours, and those of `--with`.

    Attributes:
        paths: row -> grasps.h5; the row of another file is called as its file.
    """

    paths: Mapping[str, Path]

    @classmethod
    def of(cls, grasps: Path, others: Sequence[Path]) -> "ComparedRuns":
        """Return our `grasps` and the files `others`.

        Raises:
            ValueRangeError: two rows would have one name.
        """
        paths = {OURS: grasps}
        for path in others:
            if path.stem in (*paths, *BASELINE_ROWS):
                expected = f"another file name: {path.stem} is the name of another row"
                raise ValueRangeError("--with", path, expected)
            paths[path.stem] = path
        return cls(paths)

    def scenes(self, root: GraspNetRoot) -> dict[SceneFiles, RowPlaces]:
        """Return where the frames of each scene and camera lie, by row.

        Raises:
            FormatError: a file holds no frames, frames of another dataset, or not those of ours.
        """
        found: dict[SceneFiles, RowPlaces] = {}
        expected: dict[SceneFiles, list[str]] = {}
        for row, path in self.paths.items():
            index = read_index(path)
            names = index.dataset_names(path)
            scenes = places_by_scene(path, index, root)
            if row == OURS:
                found = {scene: {} for scene in scenes}
            for scene, rows in found.items():
                places = scenes.get(scene, [])
                there = [names[place] for place in places]
                if there != expected.setdefault(scene, there):
                    raise FormatError(path, _difference(there, expected[scene]), "run infer on all")
                rows[row] = path, places
        return found


def frames_by_row(places: RowPlaces) -> Iterator[dict[str, FrameResult]]:
    """Yield each frame of a scene as every row has it."""
    for results in zip(*(read_dataset_frames(*each) for each in places.values()), strict=True):
        yield dict(zip(places, results, strict=True))


def _difference(names: Sequence[str], expected: Sequence[str]) -> str:
    missing = sorted(set(expected) - set(names))
    if missing:
        return f"lacks {len(missing)} frames of ours, as {missing[0]}"
    return f"has frames that ours lacks, as {sorted(set(names) - set(expected))[0]}"
