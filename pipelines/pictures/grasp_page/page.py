"""HTML of a frame's page, and of the index of all frames. No page loads anything by network."""

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
    """A frame in the index: a summary, and the paths of its page and picture, if any."""

    name: str
    page: str | None  # relative to the index
    picture: str | None  # relative to the index
    words: str  # summary of the result, or the reason for a missing page
    failed: bool = False


def frame_page(scene: Mapping[str, Any], result: FrameResult, stamp: Stamp) -> str:
    """Return the page of a frame, given its `scene` of `frame_scene`."""
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
    """Return the page that lists all frames, each with a picture and a link."""
    return rendered(HERE / "index.html", title=title, entries=entries, stamp=stamp.as_text())


def result_words(result: FrameResult) -> str:
    """Return a summary of the result of a frame."""
    if result.status != "ok":
        return f"{result.status}: {result.message}"
    grasps, regions = len(result.grasps), len(result.regions)
    held = len(set(result.grasps.region.tolist()))
    words = (
        f"{grasps} grasp{'s' * (grasps != 1)} on {held} of {regions} region{'s' * (regions != 1)}"
    )
    return f"{words}; {result.message}" if result.message else words
