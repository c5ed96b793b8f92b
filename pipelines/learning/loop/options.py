"""Length and speed of a training."""

from dataclasses import dataclass

from pipelines.configs import (
    FinetuneDetectorConfig,
    TrainBaselineConfig,
    TrainConfig,
    TrainCriticConfig,
)
from pipelines.learning.loop.runs import RunRequest

LearningConfig = TrainConfig | FinetuneDetectorConfig | TrainCriticConfig | TrainBaselineConfig


@dataclass(frozen=True)
class LoopOptions:
    """How long and how fast to train.

    Attributes:
        epochs: passes over the data.
        learning_rate: of Adam, at first.
        decay: factor of the learning rate every `decay_epochs` epochs (Sec. III-G).
        decay_epochs: may be a fraction of an epoch.
        ema_decay: of the running mean of the weights, which is what is validated and kept.
        clip_norm: gradients longer than this are shortened to it.
        seed: of everything drawn at random.
        threads: micro-batches worked on at a time.
        max_seconds: time after which the run stops cleanly, None for no limit.
        checkpoint_minutes: between checkpoints.
        log_seconds: between log lines.
        progress: a bar on stderr instead of log lines.
        loaders: processes that load batches ahead; 0 for a thread of this one.
    """

    epochs: int
    learning_rate: float
    decay: float
    decay_epochs: float
    ema_decay: float = 0.998
    clip_norm: float = 10.0
    seed: int = 0
    threads: int = 1
    max_seconds: float | None = None
    checkpoint_minutes: float = 3.0
    log_seconds: float = 20.0
    progress: bool = False
    loaders: int = 0

    @classmethod
    def of(cls, config: LearningConfig, request: RunRequest) -> "LoopOptions":
        """Return what the config of a stage says of steps, and the request of this run."""
        return cls(
            epochs=config.epochs,
            learning_rate=config.learning_rate,
            decay=config.decay,
            decay_epochs=config.decay_epochs,
            ema_decay=config.ema_decay,
            seed=request.seed,
            threads=request.threads,
            max_seconds=request.max_seconds,
            progress=request.progress,
            loaders=request.loaders,
        )
