"""History of a training, for its curves: loss terms by step, figures of validations.

It is kept in the checkpoint, so that the curves of a resumed run are whole.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

MOST_POINTS = 400  # of a curve; one that grows longer is thinned to half


@dataclass
class History:
    """Curves of one training.

    Attributes:
        every: steps that a point of `train` stands for.
        train: by term, means over `every` steps each.
        val: by figure, pairs (steps done, value).
    """

    every: int = 1
    train: dict[str, list[float]] = field(default_factory=dict)
    val: dict[str, list[tuple[int, float]]] = field(default_factory=dict)
    pending: dict[str, float] = field(default_factory=dict)  # sums over the steps since
    num_pending: int = 0

    def add_losses(self, losses: Mapping[str, float]) -> None:
        """Add the loss terms of one step."""
        self.pending = {name: self.pending.get(name, 0.0) + value for name, value in losses.items()}
        self.num_pending += 1
        if self.num_pending < self.every:
            return
        for name, value in self.pending.items():
            self.train.setdefault(name, []).append(value / self.num_pending)
        self.pending, self.num_pending = {}, 0
        if len(next(iter(self.train.values()))) >= MOST_POINTS:
            pairs = {name: (each[::2], each[1::2]) for name, each in self.train.items()}
            self.train = {
                name: [0.5 * (a + b) for a, b in zip(*pair, strict=True)]
                for name, pair in pairs.items()
            }
            self.every *= 2

    def add_figures(self, steps: int, figures: Mapping[str, float]) -> None:
        """Add the figures of a validation after `steps` steps."""
        for name, value in figures.items():
            self.val.setdefault(name, []).append((steps, value))

    def curve(self, term: str) -> list[tuple[float, float]]:
        """Return points (steps done, mean) of a loss term."""
        values = self.train.get(term, [])
        return [((i + 0.5) * self.every, value) for i, value in enumerate(values)]
