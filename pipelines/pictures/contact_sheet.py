"""Contact sheets: the pictures of many annotated objects, the most doubtful first.

Writes  DIR/sheet_NN.png   24 objects per page, for review by a person
        DIR/index.html     all objects on one page, with the facts of each as text
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pipelines.dataset.symmetry.symmetry_labels import FOUND, ObjectSymmetries
from pipelines.errors import SymgraspError
from pipelines.geometry.symmetry import RotationSymmetry, Symmetry
from pipelines.pictures.pages import rendered
from pipelines.pictures.palette import Color, ColorImage
from pipelines.storage.files import write_text
from pipelines.storage.images import write_image
from pipelines.storage.provenance import PAGE_HEAD

SHEET_COLUMNS, SHEET_ROWS = 4, 6
CAPTION, GAP, TITLE = 62, 10, 44  # pixels
FINE = 2  # text is drawn larger by this factor, then averaged
INK: Color = (30, 30, 30)
GREY: Color = (115, 115, 115)
CORRECTED: Color = (20, 120, 60)
CALM, ALARM = np.array([70, 160, 90]), np.array([205, 40, 30])  # of doubt 0 and 1
BAR = 64  # pixels, the width of doubt 1
LEGEND = (
    "pink, blue, amber sheets: mirrors 0, 1, 2   red: axes, spheres   "
    "coloured surface: regions   dashed grey: nearest rejected"
)
OUR_TITLE = "<title>Symmetries</title>"
SHEET = re.compile(r"sheet_\d{2,}\.png")
TEMPLATE = Path(__file__).with_suffix(".html")


@dataclass(frozen=True)
class Tile:
    """One object: views (h, w, 3) RGB, annotation, and the path of the picture."""

    name: str
    views: ColorImage
    labels: ObjectSymmetries
    picture: str  # path relative to the sheets' folder

    @property
    def doubt(self) -> float:
        """The object's doubt; 1 where the doubt is unknown."""
        return 1.0 if self.labels.doubt is None else self.labels.doubt


def write_sheets(folder: Path, tiles: Sequence[Tile]) -> list[Path]:
    """Write the pages and the index of `tiles`; return the pages, the most doubtful first."""
    ranked = sorted(tiles, key=lambda tile: (-tile.doubt, tile.name))
    size = SHEET_COLUMNS * SHEET_ROWS
    pages = [ranked[start : start + size] for start in range(0, len(ranked), size)]
    index, *paths = page_paths(folder, len(tiles))
    earlier = {path for path in folder.glob("sheet_*.png") if SHEET.fullmatch(path.name)}
    for old in earlier - set(paths):
        old.unlink()
    for number, (path, page) in enumerate(zip(paths, pages, strict=True)):
        title = f"page {number + 1} of {len(pages)}, most doubtful first"
        write_image(path, draw_sheet(page, title, first_rank=number * size + 1))
    write_text(index, _index(ranked))
    return paths


def page_paths(folder: Path, count: int) -> list[Path]:
    """Return the paths of the index and of the pages of `count` objects."""
    pages = -(-count // (SHEET_COLUMNS * SHEET_ROWS))
    numbers = range(1, pages + 1)
    return [folder / "index.html", *(folder / f"sheet_{number:02d}.png" for number in numbers)]


def refuse_other_index(folder: Path) -> None:
    """Raise SymgraspError if there is an `index.html` in `folder` that is not one of ours."""
    index = folder / "index.html"
    if not index.is_file():
        return
    with index.open(encoding="utf-8", errors="replace") as stream:
        is_ours = OUR_TITLE in stream.read(PAGE_HEAD)
    if not is_ours:
        raise SymgraspError(
            f"{index} exists and is no page of annotate-symmetry; choose another --pictures"
        )


def draw_sheet(tiles: Sequence[Tile], title: str, first_rank: int = 1) -> ColorImage:
    """Return one page (H, W, 3) RGB of at most SHEET_COLUMNS x SHEET_ROWS `tiles`."""
    height, width = tiles[0].views.shape[:2]
    step_x, step_y = width + GAP, height + CAPTION + GAP
    rows = -(-len(tiles) // SHEET_COLUMNS)
    page = np.full((TITLE + rows * step_y, SHEET_COLUMNS * step_x + GAP, 3), 235, np.uint8)
    page[:TITLE] = _title(title, page.shape[1])
    for index, tile in enumerate(tiles):
        y = TITLE + (index // SHEET_COLUMNS) * step_y
        x = GAP + (index % SHEET_COLUMNS) * step_x
        page[y : y + height, x : x + width] = tile.views
        caption = _caption(tile, first_rank + index, width)
        page[y + height : y + height + CAPTION, x : x + width] = caption
    return page


def symmetry_words(symmetries: Iterable[Symmetry]) -> str:
    """Return `symmetries` as a few words: `2 mirrors, axis x2`."""
    words: dict[str, int] = {}
    for symmetry in symmetries:
        name = "mirror" if symmetry.kind == "reflection" else symmetry.kind
        if isinstance(symmetry, RotationSymmetry):
            name = "round axis" if symmetry.order is None else f"axis x{symmetry.order}"
        words[name] = words.get(name, 0) + 1
    counted = [name if count == 1 else f"{count} {name}s" for name, count in words.items()]
    return ", ".join(counted) or "no symmetry"


def remark(labels: ObjectSymmetries) -> str:
    """Return further facts: sources of the annotation, parts, nearest rejected candidate."""
    sources = sorted(set(labels.all_sources) - {FOUND})
    parts = [f"by {source}" for source in sources]
    if labels.found is not None and not sources:
        parts.append("by hand")
    if len(labels.regions) > 1 or any(region.name != "whole" for region in labels.regions):
        parts += [
            f"{region.name}: {symmetry_words(region.symmetries)}" for region in labels.regions
        ]
    elif labels.rejected:
        near = labels.rejected[0]
        parts.append(f"nearest rejected: {symmetry_words([near])}, error {near.error:.4f}")
    return "; ".join(parts)


def facts(labels: ObjectSymmetries) -> str:
    """Return the object's symmetries and their largest error in words."""
    worst = max((symmetry.error for symmetry in labels.symmetries), default=None)
    return symmetry_words(labels.symmetries) + ("" if worst is None else f", error {worst:.4f}")


def _caption(tile: Tile, rank: int, width: int) -> ColorImage:
    strip = np.full((CAPTION * FINE, width * FINE, 3), 255, np.uint8)
    color = _doubt_color(tile.doubt)
    right = "doubt ?" if tile.labels.doubt is None else f"doubt {tile.doubt:.2f}"
    room = width - 90
    _write(strip, f"{rank}. {tile.name}", (6, 17), 0.46, INK, room=room, bold=True)
    _write(strip, right, (width - 82, 17), 0.4, color, room=82)
    left, filled = width - 6 - BAR, round(BAR * tile.doubt)
    strip[24 * FINE : 29 * FINE, left * FINE : (left + BAR) * FINE] = 225
    strip[24 * FINE : 29 * FINE, left * FINE : (left + filled) * FINE] = color
    _write(strip, facts(tile.labels), (6, 36), 0.42, INK, room=room)
    ink = CORRECTED if tile.labels.found is not None else GREY
    _write(strip, remark(tile.labels), (6, 54), 0.36, ink, room=width - 12)
    return _averaged(strip)


def _title(text: str, width: int) -> ColorImage:
    strip = np.full((TITLE * FINE, width * FINE, 3), 235, np.uint8)
    _write(strip, text, (GAP, 29), 0.6, INK, room=420, bold=True)
    _write(strip, LEGEND, (440, 28), 0.45, GREY, room=width - 450)
    return _averaged(strip)


def _write(
    strip: ColorImage, text: str, place: tuple[int, int], scale: float, color: Color,
    *, room: int, bold: bool = False,
) -> None:  # fmt: skip
    """Write `text` at `place`, cut off so that it fits `room` pixels."""
    font = cv2.FONT_HERSHEY_DUPLEX if bold else cv2.FONT_HERSHEY_SIMPLEX
    plain = text.encode("ascii", "replace").decode()  # the font's characters
    cut = plain

    def width(line: str) -> int:
        return int(cv2.getTextSize(line, font, scale * FINE, FINE)[0][0])

    while len(cut) > 1 and width(cut) > room * FINE:
        cut = cut[:-1] if cut == plain else cut[:-3]
        cut += ".."
    at = (place[0] * FINE, place[1] * FINE)
    cv2.putText(strip, cut, at, font, scale * FINE, color, FINE, cv2.LINE_AA)


def _averaged(strip: ColorImage) -> ColorImage:
    size = (strip.shape[1] // FINE, strip.shape[0] // FINE)
    return np.asarray(cv2.resize(strip, size, interpolation=cv2.INTER_AREA), np.uint8)


def _doubt_color(doubt: float) -> Color:
    r, g, b = np.rint(CALM + float(np.clip(doubt, 0, 1)) * (ALARM - CALM)).astype(int)
    return int(r), int(g), int(b)


def _index(ranked: Sequence[Tile]) -> str:
    objects = [
        {
            "name": tile.name,
            "picture": tile.picture,
            "doubt": "?" if tile.labels.doubt is None else f"{tile.doubt:.2f}",
            "color": _doubt_color(tile.doubt),
            "lines": [words for words in (facts(tile.labels), remark(tile.labels)) if words],
        }
        for tile in ranked
    ]
    return rendered(TEMPLATE, objects=objects, legend=LEGEND)
