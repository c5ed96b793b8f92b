"""Settings of the methods that the paper compares with, trained here on the same data (D. 133)."""

from dataclasses import dataclass, field, replace
from typing import Literal

from pipelines.configs.dataset import FRAME_STRIDE
from pipelines.configs.declaration import BY_EYE, choice, setting
from pipelines.configs.learning import DECAY, EMA_DECAY, MICRO_BATCH_MEANING, VAL_FRACTION

Variant = Literal["light", "full"]

OWN = "0 for the method's default."


@dataclass(frozen=True)
class PeerNetworkConfig:
    """The network of a compared method."""

    variant: Variant = choice(
        "light", "Network: light, for a CPU, or full, the larger published network.", "D. 133"
    )


@dataclass(frozen=True)
class PeerSchedule:
    """Default schedule of one method, for settings of `train-baseline` that are 0.

    Attributes:
        steps: steps of Adam.
        epoch_steps: steps between validations.
        batch_size: items in a step.
        learning_rate: initial learning rate.
        decay_steps: steps after which the learning rate falls.
    """

    steps: int
    epoch_steps: int
    batch_size: int
    learning_rate: float
    decay_steps: int


@dataclass(frozen=True)
class TrainBaselineConfig:
    """Training of a compared method on a dataset in GraspNet-1Billion's layout."""

    network: PeerNetworkConfig = field(default_factory=PeerNetworkConfig)
    steps: int = setting(0, "count", f"Steps of the training; {OWN}", "D. 133")
    epoch_steps: int = setting(0, "count", f"Steps between validations; {OWN}", "D. 133")
    batch_size: int = setting(0, "count", f"Items in a step; {OWN}", "D. 133")
    micro_batch_size: int = setting(0, "count", MICRO_BATCH_MEANING, "D. 58")
    learning_rate: float = setting(
        0.0, "factor", f"Learning rate of Adam, at first; {OWN}", "D. 133"
    )
    decay: float = setting(0.5, "share", DECAY.replace("epochs", "steps"), BY_EYE)
    decay_steps: int = setting(
        0, "count", f"Steps after which the learning rate falls; {OWN}", "D. 133"
    )
    ema_decay: float = setting(0.998, "share", EMA_DECAY, BY_EYE)
    frame_stride: int = setting(1, "count", FRAME_STRIDE, BY_EYE, low=1)
    max_val_frames: int = setting(120, "count", "Most frames of a validation.", BY_EYE, low=1)
    val_fraction: float = setting(0.1, "share", VAL_FRACTION, BY_EYE)

    def with_schedule(self, schedule: PeerSchedule) -> "TrainBaselineConfig":
        """Return the settings with each 0 replaced by the value of `schedule`."""
        own = {name: value for name, value in vars(schedule).items() if not getattr(self, name)}
        return replace(self, **own)

    @property
    def epochs(self) -> int:
        """Number of validations in `steps`, rounded up."""
        return -(-self.steps // self.epoch_steps)

    @property
    def decay_epochs(self) -> float:
        """`decay_steps` in units of `epoch_steps`."""
        return self.decay_steps / self.epoch_steps
