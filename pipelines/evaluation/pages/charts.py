"""Line charts as inline SVG: axes with ticks and labels, one line a series, a legend below."""

import html
from collections.abc import Sequence
from dataclasses import dataclass

WIDTH, HEIGHT = 420, 290
LEFT, RIGHT, TOP, BOTTOM = 52, 12, 12, 44  # pixels around the plot
INK, GRID = "#4a4f57", "#e3e6ea"
TICKS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)  # of an axis' length; y runs from 0 to 1


@dataclass(frozen=True)
class Series:
    """One line: its name in the legend, its points, and how it is drawn."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    color: str
    dashes: str = ""  # of SVG's stroke-dasharray; solid if empty


def line_chart(
    title: str, x_label: str, y_label: str, series: Sequence[Series], x_end: float = 1.0
) -> str:
    """Return a figure of HTML with the chart of `series`, x from 0 to `x_end`, y to 1."""
    lines = "".join(_line(each, x_end) for each in series)
    words = f'role="img" aria-label="{html.escape(title)}"'
    legend = "".join(
        f'<span><svg width="26" height="8"><line x1="1" x2="25" y1="4" y2="4" {_stroke(each)}/>'
        f"</svg> {html.escape(each.name)}</span>"
        for each in series
    )
    return (
        f'<figure class="chart"><figcaption>{html.escape(title)}</figcaption>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" {words}>{_axes(x_label, y_label, x_end)}{lines}</svg>'
        f'<div class="legend">{legend}</div></figure>'
    )


def _axes(x_label: str, y_label: str, x_end: float) -> str:
    parts = []
    for tick in TICKS:
        x, y = _place(tick, tick)
        bottom, left = HEIGHT - BOTTOM, LEFT
        parts += [
            f'<line x1="{x}" x2="{x}" y1="{TOP}" y2="{bottom}" stroke="{GRID}"/>',
            f'<line x1="{left}" x2="{WIDTH - RIGHT}" y1="{y}" y2="{y}" stroke="{GRID}"/>',
            f'<text x="{x}" y="{bottom + 16}" text-anchor="middle">{tick * x_end:g}</text>',
            f'<text x="{left - 7}" y="{y + 4}" text-anchor="end">{tick:g}</text>',
        ]
    middle_x, middle_y = _place(0.5, 0.5)
    parts += [
        f'<text x="{middle_x}" y="{HEIGHT - 8}" text-anchor="middle">{html.escape(x_label)}</text>',
        f'<text transform="translate(14 {middle_y}) rotate(-90)" text-anchor="middle">'
        f"{html.escape(y_label)}</text>",
        f'<path d="M{LEFT} {TOP}V{HEIGHT - BOTTOM}H{WIDTH - RIGHT}" fill="none" stroke="{INK}"/>',
    ]
    return "".join(parts)


def _line(series: Series, x_end: float) -> str:
    points = " ".join(
        "{},{}".format(*_place(x / x_end, y)) for x, y in zip(series.x, series.y, strict=True)
    )
    return f'<polyline points="{points}" fill="none" {_stroke(series)}/>'


def _stroke(series: Series) -> str:
    dashes = f' stroke-dasharray="{series.dashes}"' if series.dashes else ""
    return f'stroke="{series.color}" stroke-width="2.2"{dashes}'


def _place(x: float, y: float) -> tuple[float, float]:
    """Return the pixel of a point of the plot, both coordinates from 0 to 1."""
    across = LEFT + x * (WIDTH - LEFT - RIGHT)
    return round(across, 1), round(TOP + (1.0 - y) * (HEIGHT - TOP - BOTTOM), 1)
