"""The HTML of a frame's page, and of the index of all frames. No page loads anything from a net."""

import html
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from pipelines.grasp_files.grasps_file import FrameResult
from pipelines.storage.provenance import Stamp, page_stamp

HERE = Path(__file__).parent
SCRIPTS = ("vectors.js", "drawing.js", "content.js", "orbit.js", "viewer.js")  # in this order
# The browser refuses whatever is not in the page itself.
NO_NETWORK = "; ".join((
    "default-src 'none'",
    "script-src 'unsafe-inline'",
    "style-src 'unsafe-inline'",
    "img-src 'self' data:",
))  # fmt: skip
KEYS = (
    ("drag", "turn"),
    ("right drag, or Shift", "move"),
    ("wheel", "zoom"),
    ("click", "a grasp's figures"),
    ("R", "reset"),
    ("T", "from above"),
    ("C", "as the camera"),
    ("N", "next grasp"),
    ("+ -", "grasps a region"),
    ("H S P", "hands, symmetries, points on and off"),
    ("Esc", "no grasp"),
)


@dataclass(frozen=True)
class IndexEntry:
    """A frame in the index: what became of it, and its page if there is one.

    Attributes:
        name: of the frame.
        page: relative to the index; None where there is none.
        picture: relative to the index; None where there is none.
        words: what was found, or why there is no page.
        failed: whether something is wrong with the frame.
    """

    name: str
    page: str | None
    picture: str | None
    words: str
    failed: bool = False


def frame_page(scene: Mapping[str, Any], result: FrameResult, stamp: Stamp) -> str:
    """Return the page of a frame, given what is drawn of it."""
    data = json.dumps(scene, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    script = "\n".join(_file(name) for name in SCRIPTS)
    up = "../" * (result.name.count("/") + 1)
    body = (
        f'<header><a href="{up}index.html">all frames</a><h1>{html.escape(result.name)}</h1>'
        f"<p>{html.escape(in_words(result))}</p></header>\n{_controls(scene)}"
        '<main><canvas id="view" tabindex="0" aria-label="cloud and grasps"></canvas>'
        '<p id="trouble" hidden></p></main>\n'
        f'<script type="application/json" id="scene">{data}</script>\n'
        f'<script>(() => {{ "use strict";\n{script}\n}})();</script>'
    )
    return _whole(f"{result.name}: grasps", _file("frame.css"), body, stamp)


def index_page(title: str, entries: Iterable[IndexEntry], stamp: Stamp) -> str:
    """Return the page that lists all frames, with a picture and a link each."""
    figures = "\n".join(map(_figure, entries))
    body = f"<h1>{html.escape(title)}</h1>\n<div>{figures}</div>"
    return _whole(title, _file("index.css"), body, stamp)


def in_words(result: FrameResult) -> str:
    """Return what was found in a frame."""
    if result.status != "ok":
        return f"{result.status}: {result.message}"
    grasps, regions = len(result.grasps), len(result.regions)
    held = len(set(result.grasps.region.tolist()))
    words = (
        f"{grasps} grasp{'s' * (grasps != 1)} on {held} of {regions} region{'s' * (regions != 1)}"
    )
    return f"{words}; {result.message}" if result.message else words


def _figure(entry: IndexEntry) -> str:
    name, words = html.escape(entry.name), html.escape(entry.words)
    picture = (
        f'<img loading="lazy" alt="" src="{_link(entry.picture)}">' if entry.picture else "<i></i>"
    )
    kind = ' class="failed"' if entry.failed else ""
    caption = f"{picture}<figcaption><b>{name}</b>{words}</figcaption>"
    linked = f'<a href="{_link(entry.page)}">{caption}</a>' if entry.page else caption
    return f"<figure{kind}>{linked}</figure>"


def _link(path: str | None) -> str:
    return html.escape(quote(path or ""))


def _controls(scene: Mapping[str, Any]) -> str:
    keys = "".join(f"<dt>{html.escape(key)}</dt><dd>{html.escape(what)}</dd>" for key, what in KEYS)
    options = "".join(f"<option>{name}</option>" for name in ("score", "region", "source"))
    more = scene["left_out"]
    left_out = f"; {more} more grasps are in the file, not here" if more else ""
    return (
        "<aside>"
        '<section id="picked" aria-live="polite" hidden></section>'
        "<section>"
        '<label>grasps a region <output id="count-shown"></output>'
        '<input id="count" type="range" min="0" max="1" value="1"></label>'
        '<label>symmetries from confidence <output id="trust-shown"></output>'
        '<input id="trust" type="range" min="0" max="1" step="0.05" value="0.5"></label>'
        '<label>regions in colour <input id="tint" type="range" min="0" max="1" step="0.05" '
        'value="0.25"></label>'
        f'<label class="row">hands coloured by <select id="by">{options}</select></label>'
        '<div id="legend"></div>'
        '<label class="row"><input id="hands" type="checkbox" checked> hands</label>'
        '<label class="row"><input id="clear" type="checkbox"> see through hands</label>'
        '<label class="row"><input id="symmetries" type="checkbox" checked> symmetries</label>'
        '<label class="row"><input id="points" type="checkbox" checked> points</label>'
        '<p class="row"><button id="reset">reset</button><button id="top">from above</button>'
        '<button id="camera">as the camera</button></p>'
        "</section>"
        '<section><h2>regions</h2><ul id="regions"></ul></section>'
        f"<section><details><summary>keys</summary><dl>{keys}</dl></details>"
        f"<p>gripper {html.escape(str(scene['gripper']))}{left_out}</p></section></aside>\n"
    )


def _whole(title: str, style: str, body: str, stamp: Stamp) -> str:
    head = (
        f'<meta charset="utf-8">{page_stamp(stamp)}'
        f'<meta http-equiv="Content-Security-Policy" content="{NO_NETWORK}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{style}</style>"
    )
    return f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>\n{body}\n</body></html>\n'


def _file(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")
