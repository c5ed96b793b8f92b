"""`report.html`: a report as one page that needs no other file and no network."""

import html
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pipelines.evaluation.pages.charts import Series, line_chart
from pipelines.evaluation.pages.gallery import Gallery, Picture, Tag
from pipelines.evaluation.pages.page_style import STYLE
from pipelines.evaluation.tables import METHODS, Table, report_tables
from pipelines.evaluation.tallies import ALL
from pipelines.metrics.grasp_verdicts import REASONS
from pipelines.metrics.symmetry_matching import KINDS

ROW_COLORS = {"ours": "#1668b8", "oracle": "#2a9d58", "planar": "#e08a00", "random": "#8a8f98"}
THRESHOLD_DASHES = ("", "7 4", "2 3")
REASON_COLORS = dict(
    zip(REASONS, ("#b9bec6", "#8d939d", "#8e5bb5", "#d0492f", "#e6a817", "#f0d264", "#2f9e5b"),
        strict=True)
)  # fmt: skip
REASON_WORDS = {
    "no region": "no region of the detector lies on it",
    "no grasp": "its regions gave no grasp",
    "too wide": "wider than the gripper opens",
    "collision": "the open gripper touches an object or the table",
    "no contact": "the closing fingers do not both touch it",
    "friction": "it would need friction above 1",
    "held": "held",
}
GALLERY_NOTE = (
    "A scene shows at most its best and its worst frame. Hands: green where a symmetry gave the "
    "grasp, orange where the boundary did; red dots are contacts. Sheets are mirror planes, red "
    "lines axes, red rings spheres. A number has the colour of what became of its object."
)


def report_page(report: Mapping[str, Any], gallery: Gallery) -> str:
    """Return the page of a `report.json` and its `gallery`."""
    quality, pair, region, *success, symmetry, masks, reasons = report_tables(report)
    sections = (
        ("Grasps", (_columns((*map(html_table, (quality, pair, region)), _held_chart(report))),)),
        ("Success", tuple(map(html_table, success))),
        ("Symmetries", (html_table(symmetry), _symmetry_charts(report))),
        ("Region masks", (html_table(masks),)),
        ("What became of the objects", (_reason_bars(report), folded(reasons))),
        ("Best frames", (f'<p class="note">{GALLERY_NOTE}</p>', _gallery(gallery.best))),
        ("Worst frames", (_gallery(gallery.worst),)),
        ("How this was made", (provenance_table(report),)),
    )
    counted = _ours(report)
    title = f"SymGrasp: {counted.get('frames', 0)} frames, {counted.get('objects', 0)} objects"
    return whole_page(title, _summary(report) + page_sections(sections))


def page_sections(sections: Iterable[tuple[str, Iterable[str]]]) -> str:
    """Return titles with their parts of HTML, one below the other."""
    return "".join(
        f"<section><h2>{html.escape(title)}</h2>{''.join(parts)}</section>"
        for title, parts in sections
    )


def whole_page(title: str, body: str) -> str:
    """Return an HTML page of a title and a body; light, and readable on a phone."""
    head = (
        '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title)}</title><style>{STYLE}</style>"
    )
    return (
        f'<!doctype html>\n<html lang="en"><head>{head}</head>\n'
        f"<body><h1>{html.escape(title)}</h1>\n{body}\n</body></html>\n"
    )


def html_table(table: Table) -> str:
    """Return a table that scrolls by itself where the screen is narrow."""
    head = _row("th", table.header, "", table.names)
    body = "\n".join(
        _row("td", row, "paper" if index < table.published else "", table.names)
        for index, row in enumerate(table.rows)
    )
    note = f'<p class="note">{html.escape(table.note)}</p>' if table.note else ""
    return (
        f'<div class="wide"><table><caption>{html.escape(table.title)}</caption>\n'
        f"<thead>{head}</thead><tbody>{body}</tbody></table></div>{note}"
    )


def note_list(notes: Iterable[str]) -> str:
    """Return sentences as a list."""
    return f"<ul>{''.join(f'<li>{html.escape(note)}</li>' for note in notes)}</ul>"


def _columns(parts: Iterable[str]) -> str:
    blocks = "".join(f"<div>{part}</div>" for part in parts)
    return f'<div class="columns">{blocks}</div>'


def _row(tag: str, cells: Sequence[str], kind: str, names: int) -> str:
    attribute = f' class="{kind}"' if kind else ""
    text = "".join(
        f"<{tag}{' class=name' if index < names else ''}>{html.escape(cell)}</{tag}>"
        for index, cell in enumerate(cells)
    )
    return f"<tr{attribute}>{text}</tr>"


def folded(table: Table) -> str:
    """Return a table that a click unfolds."""
    return f"<details><summary>by split, as numbers</summary>{html_table(table)}</details>"


def _summary(report: Mapping[str, Any]) -> str:
    """Return the figures that one asks for first, as tiles."""
    figures = _ours(report)
    precision = figures.get("symmetry_ap", {})
    seconds = report.get("seconds_per_frame")
    tiles = [
        ("grasp quality", figures.get("grasp_quality"), "0.382 seen, 0.297 unseen"),
        ("antipodal score", figures.get("antipodal_score"), "0.809 seen, 0.715 unseen"),
        ("AP reflection", precision.get("reflection"), "0.56"),
        ("AP rotation", precision.get("rotation"), "0.61"),
        ("AP sphere", precision.get("sphere"), "0.73"),
        ("mask AP50", figures.get("mask_ap50"), "0.72 seen, 0.55 unseen"),
        ("seconds a frame", seconds, "0.3"),
    ]
    success = figures.get("success", {}).get(ALL, {})
    if success:
        tiles.insert(2, ("success in simulation", success["rate"], "0.47 to 0.74, real"))
    return tile_row(
        ("-" if value is None else f"{value:.3f}", name, f"paper: {paper}")
        for name, value, paper in tiles
    )


def tile_row(tiles: Iterable[tuple[str, str, str]]) -> str:
    """Return a row of figures: the figure, its name, what stands small below."""
    cells = "".join(
        f"<div><b>{html.escape(figure)}</b><span>{html.escape(name)}</span>"
        f"<small>{html.escape(below)}</small></div>"
        for figure, name, below in tiles
    )
    return f'<div class="tiles">{cells}</div>'


def _ours(report: Mapping[str, Any]) -> Mapping[str, Any]:
    figures: Mapping[str, Any] = report["rows"].get("ours", {}).get(ALL, {})
    return figures


def _held_chart(report: Mapping[str, Any]) -> str:
    curves = report.get("curves", {})
    lines = [
        Series(METHODS[row], curves["friction"], share, ROW_COLORS[row])
        for row, share in curves.get("held", {}).items()
    ]
    title = "Share of objects held at a friction, all splits"
    return line_chart(title, "friction", "share of visible objects", lines) if lines else ""


def _symmetry_charts(report: Mapping[str, Any]) -> str:
    """Return precision-recall of ours, a chart a kind with a line a threshold."""
    curves = report.get("curves", {})
    found = curves.get("symmetry", {}).get("ours", {})
    charts, blue = [], ROW_COLORS["ours"]
    for kind in KINDS:
        measure = "centre within {} m" if kind == "sphere" else "error below {}"
        lines = [
            Series(measure.format(key), *_reached(curves["recall"], precision), blue, dashes)
            for (key, precision), dashes in zip(
                found.get(kind, {}).items(), THRESHOLD_DASHES, strict=False
            )
        ]
        if lines:
            charts.append(line_chart(f"{kind}, all splits", "recall", "precision", lines))
    return f'<div class="charts">{"".join(charts)}</div>'


def _reached(
    recall: Sequence[float], precision: Sequence[float]
) -> tuple[Sequence[float], Sequence[float]]:
    """Return a curve up to the first recall that no prediction reaches."""
    end = next((place + 1 for place, value in enumerate(precision) if not value), len(precision))
    return recall[:end], precision[:end]


def _reason_bars(report: Mapping[str, Any]) -> str:
    """Return a bar a method, as long as the shares of its objects, and what the colours mean."""
    bars = [(METHODS[row], splits[ALL]["reasons"]) for row, splits in report["rows"].items()]
    return stacked_bars(bars, REASON_COLORS, REASON_WORDS)


def stacked_bars(
    bars: Iterable[tuple[str, Mapping[str, int]]],
    colors: Mapping[str, str],
    words: Mapping[str, str],
) -> str:
    """Return a bar a name, cut by counts of `colors`' keys in order, and what the colours mean."""
    lines = []
    for name, counts in bars:
        total = sum(counts.values())
        parts = "".join(
            f'<i style="flex:{counts[key]};background:{color}" '
            f'title="{key}: {counts[key]} of {total}">{_share(counts[key], total)}</i>'
            for key, color in colors.items()
            if counts.get(key)
        )
        lines.append(f"<span>{html.escape(name)}</span><div>{parts}</div>")
    legend = "".join(
        f'<span><i style="background:{color}"></i> <b>{key}</b>: {words[key]}</span>'
        for key, color in colors.items()
    )
    return f'<div class="bars">{"".join(lines)}</div><div class="legend tall">{legend}</div>'


def _share(count: int, total: int) -> str:
    return f"{100 * count / total:.0f} %" if count >= 0.06 * total else ""


def _gallery(pictures: Iterable[Picture]) -> str:
    return f'<div class="gallery">{"".join(map(_picture, pictures))}</div>'


def _picture(picture: Picture) -> str:
    data = b64encode(picture.jpeg).decode("ascii")
    width, height = picture.size
    numbered = list(enumerate(picture.tags, 1))
    tags = "".join(
        f'<b style="left:{100 * tag.place[0]:.1f}%;top:{100 * tag.place[1]:.1f}%;'
        f'background:{_color(tag)}">{number}</b>'
        for number, tag in numbered
    )
    lines = "".join(
        f'<li><b style="background:{_color(tag)}">{number}</b> {html.escape(_words(tag))}</li>'
        for number, tag in numbered
    )
    name = html.escape(picture.name)
    return (
        f'<figure><div class="shot"><img alt="{name}" width="{width}" height="{height}" '
        f'src="data:image/jpeg;base64,{data}">{tags}</div><figcaption>{name}, {picture.split}: '
        f"mean quality {picture.quality:.2f}</figcaption><ol>{lines}</ol></figure>"
    )


def _color(tag: Tag) -> str:
    return REASON_COLORS[tag.verdict.reason]


def _words(tag: Tag) -> str:
    verdict = tag.verdict
    if verdict.reason == "held":
        return f"{tag.name}: held, quality {verdict.quality:.2f}"
    return f"{tag.name}: {verdict.reason}"


def provenance_table(report: Mapping[str, Any]) -> str:
    """Return how a report was made."""
    stamp = report.get("provenance", {})
    facts = [("symgrasp", stamp.get("version")), ("seed", stamp.get("seed"))]
    facts += [*stamp.get("inputs", {}).items(), *stamp.get("config", {}).items()]
    rows = tuple((str(name), str(value)) for name, value in facts)
    return html_table(Table("Settings and inputs", ("name", "value"), rows, names=2))
