"""Check that a dataset has the frames that `infer` read.

Scenes of two datasets may have the same numbers. A `grasps.h5` holds the place and a digest of all
frames that were read. Where two datasets are there, a frame of each scene is compared first, since
a digest takes all files.
"""

from collections.abc import Sequence
from pathlib import Path

from pipelines.contents import mapping_in
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.errors import FormatError, SymgraspError
from pipelines.frames.frame_inputs import is_made_of
from pipelines.frames.frames_record import FramesRecord
from pipelines.grasp_files.grasps_stream import GraspsIndex
from pipelines.storage.files import real_path


def refuse_another_dataset(
    path: Path, index: GraspsIndex, places: Sequence[int], root: GraspNetRoot
) -> None:
    """Raise FormatError if `infer` read other frames than those of `root`.

    A dataset elsewhere may be the one of the grasps with noisier images or better poses.

    Args:
        path: the `grasps.h5`.
        index: its contents.
        places: of the frames to compare with those that `infer` read, if these are elsewhere.
        root: a dataset that has all frames.
    """
    names = index.dataset_names(path)
    read_from = {place: _read_from(path, index, place) for place in places}
    home = real_path(root.root)
    if any(each and real_path(each) == home for each in read_from.values()):
        if _are_read_frames(path, index, None) is False:
            found = f"the frames of {root.root} have changed since infer read them"
            raise FormatError(path, found, "run infer on them again")
        return
    for place, first in read_from.items():
        if first is None or not _is_another_frame(GraspNetRoot(first), root, names[place]):
            continue
        if _are_read_frames(path, index, _counterpart(path, index, first, root)):
            return  # those that were read are here; others are at their former place
        found = f"its frame {names[place]} was read from {first}, and is another in {root.root}"
        raise FormatError(path, found, "give the dataset that infer was run on")


def note_of_gone_frames(path: Path, index: GraspsIndex, root: GraspNetRoot) -> str:
    """Return a note if the frames that `infer` read are gone and differ from those of `root`."""
    read_from = _read_from(path, index, 0)
    if read_from is None or read_from.exists():
        return ""
    if _are_read_frames(path, index, _counterpart(path, index, read_from, root)) is not False:
        return ""
    return (
        f"{read_from}, where infer read its frames, is gone, and {root.root} has other files; "
        "the report is right only if both have the same scenes"
    )


def _read_from(path: Path, index: GraspsIndex, place: int) -> Path | None:
    """Return the root that `infer` read a frame from; None if that is unknown, or no dataset's."""
    if "frames" not in mapping_in(index.stamp, "recorded"):
        return None  # the file is of an earlier version
    read_as = index.frames_folder(path) / index.names[place]
    parts = Path(index.dataset_names(path)[place]).parts
    return read_as.parents[len(parts) - 1] if read_as.parts[-len(parts) :] == parts else None


def _counterpart(path: Path, index: GraspsIndex, first: Path, second: GraspNetRoot) -> Path:
    """Return the folder in `second` of the folder that `infer` read in the root `first`."""
    folder = index.frames_folder(path)
    return second.root / folder.relative_to(first) if folder.is_relative_to(first) else second.root


def _are_read_frames(path: Path, index: GraspsIndex, folder: Path | None) -> bool | None:
    """Return whether `infer` read the frames of `folder`, None for their place; as `is_made_of`."""
    try:
        sources = FramesRecord.of(path, index.attrs, folder).sources()
    except SymgraspError:  # no such frames
        return None
    return is_made_of(index.stamp, index.names, sources)


def _is_another_frame(first: GraspNetRoot, second: GraspNetRoot, name: str) -> bool:
    """Return whether poses and depth of the frame `name` differ between two datasets."""
    try:
        pairs = [
            [each.frame(name).path(kind) for each in (first, second)]
            for kind in ("annotations", "depth")
        ]
        return all(one.read_bytes() != other.read_bytes() for one, other in pairs)
    except (SymgraspError, OSError):  # such a frame is not there, or is reported where it is read
        return False
