"""HTML of a frame's page, and of the index of all frames. No page loads anything from a net."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.pictures.pages import rendered
from pipelines.storage.provenance import Stamp

HERE = Path(__file__).parent


@dataclass(frozen=True)
class IndexEntry:
    """A frame in the index: what became of it, and its page and picture if there are such."""

    name: str
    page: str | None  # relative to the index, as the picture
    picture: str | None
    words: str  # what was found, or why there is no page
    failed: bool = False


def frame_page(scene: Mapping[str, Any], result: FrameResult, stamp: Stamp) -> str:
    """Return the page of a frame, given what is drawn of it."""
    return rendered(
        HERE / "frame.html",
        title=f"{result.name}: grasps",
        stamp=stamp.as_text(),
        name=result.name,
        words=result_words(result),
        up="../" * (result.name.count("/") + 1),
        scene=scene,
    )


def index_page(title: str, entries: Iterable[IndexEntry], stamp: Stamp) -> str:
    """Return the page that lists all frames, with a picture and a link each."""
    return rendered(HERE / "index.html", title=title, entries=entries, stamp=stamp.as_text())


def result_words(result: FrameResult) -> str:
    """Return what was found in a frame."""
    if result.status != "ok":
        return f"{result.status}: {result.message}"
    grasps, regions = len(result.grasps), len(result.regions)
    held = len(set(result.grasps.region.tolist()))
    words = (
        f"{grasps} grasp{'s' * (grasps != 1)} on {held} of {regions} region{'s' * (regions != 1)}"
    )
    return f"{words}; {result.message}" if result.message else words
