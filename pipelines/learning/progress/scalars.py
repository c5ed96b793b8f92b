"""Scalars of a training in the files that TensorBoard reads."""

import io
import os
import socket
import time
from pathlib import Path
from typing import Any

from pipelines.storage.files import append_bytes


class Scalars:
    """A new file of scalars in a folder.

    torch's own writer has a thread, whose traceback a full disk would print.

    Raises:
        WriteError: there is no space, or the folder may not be written; `add` raises it too.
    """

    def __init__(self, folder: Path, first_step: int) -> None:
        """Begin the file; TensorBoard hides scalars of earlier files from `first_step` on."""
        from tensorboard.compat.proto.event_pb2 import SessionLog  # noqa: PLC0415 - slow to import

        place = f"{socket.gethostname()}.{os.getpid()}"
        self._path = folder / f"events.out.tfevents.{time.time():010.0f}.{place}"
        self._append(step=first_step, file_version="brain.Event:2")
        self._append(step=first_step, session_log=SessionLog(status=SessionLog.START))

    def add(self, name: str, value: float, step: int) -> None:
        """Write the value of a curve after `step` steps."""
        from tensorboard.compat.proto.summary_pb2 import Summary  # noqa: PLC0415 - as above

        self._append(
            step=step, summary=Summary(value=[Summary.Value(tag=name, simple_value=value)])
        )

    def _append(self, **content: Any) -> None:  # noqa: ANN401 - the fields of an event
        from tensorboard.compat.proto.event_pb2 import Event  # noqa: PLC0415 - as above
        from tensorboard.summary.writer.record_writer import RecordWriter  # noqa: PLC0415

        record = io.BytesIO()
        RecordWriter(record).write(Event(wall_time=time.time(), **content).SerializeToString())
        append_bytes(self._path, record.getvalue())
