"""`python -m tests.learning.train_toys PACKED OUTPUT`: a toy training in a separate process.

Run by torchrun it trains in several processes; it fails if threads of their group outlive it.
With `--die-at N` it is killed in step N.
"""

import os
import signal
import sys
from pathlib import Path

from pipelines import train
from pipelines.learning.loop.loop import TrainingRun
from pipelines.learning.loop.runs import RunRequest
from tests.learning.packed_toys import CONFIG


def main(arguments: list[str]) -> None:
    packed, output = map(Path, arguments[:2])
    if "--die-at" in arguments:
        die_at(int(arguments[-1]))
    train.run(packed, None, output, CONFIG, RunRequest(device="cpu", threads=1))
    if left := group_threads():
        sys.exit(f"threads of the process group live on after the training: {left}")


def group_threads() -> list[str]:
    """Return the names of this process's threads that gloo started, where the system lists them."""
    names = [path.read_text().strip() for path in Path("/proc/self/task").glob("*/comm")]
    return [name for name in names if "gloo" in name]


def die_at(step: int) -> None:
    """Write a checkpoint after every other step and kill this process in the middle of one."""
    take_step, report = TrainingRun._step, TrainingRun._report_and_save

    def dying(run, *rest):
        take_step(run, *rest)
        if run.progress.total_steps == step:
            os.kill(os.getpid(), signal.SIGKILL)

    def saving(run, batches):
        report(run, batches)
        if run.progress.total_steps % 2:
            run._save_checkpoint()

    TrainingRun._step, TrainingRun._report_and_save = dying, saving


if __name__ == "__main__":
    main(sys.argv[1:])
