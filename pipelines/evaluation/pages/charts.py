"""Line charts: series of points, and their pixels in a figure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar


@dataclass(frozen=True)
class Series:
    """One line: name in the legend, points, and style."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    color: str
    dashes: str = ""  # of SVG's stroke-dasharray; solid if empty


@dataclass(frozen=True)
class LineChart:
    """Lines over x from 0 to `x_end` and y from 0 to 1, drawn by `parts.html`."""

    title: str
    x_label: str
    y_label: str
    lines: Sequence[Series]
    x_end: float = 1.0

    width: ClassVar[int] = 420  # pixels, as are the numbers below
    height: ClassVar[int] = 290
    left: ClassVar[int] = 52  # of the plot
    right: ClassVar[int] = 408
    top: ClassVar[int] = 12
    bottom: ClassVar[int] = 246
    ticks: ClassVar[Sequence[float]] = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)  # shares of an axis' length

    def points(self, line: Series) -> list[tuple[float, float]]:
        """Return the pixels of a line's points."""
        return [self.place(x / self.x_end, y) for x, y in zip(line.x, line.y, strict=True)]

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Return the pixel of a point of the plot, both coordinates from 0 to 1."""
        across = self.left + x * (self.right - self.left)
        return round(across, 1), round(self.top + (1.0 - y) * (self.bottom - self.top), 1)
