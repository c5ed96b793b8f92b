"""The HTTP server: uvicorn with a grace period, and with an end of silent connections."""

import asyncio
import threading
import time
from types import FrameType
from typing import TYPE_CHECKING, Any

import uvicorn

from pipelines.configs import ServeConfig
from pipelines.ending import end_by_signal, set_farewell
from pipelines.serving.http_app import LONGEST_SILENCE

if TYPE_CHECKING:
    from socket import socket

    from fastapi import FastAPI

# A process may usually have 1,024 files open, and without a free one no client is accepted.
MOST_CONNECTIONS = 512
LAST_UPLOADS = 2.0  # seconds for the rest of a body when the server ends


class GraspServer(uvicorn.Server):
    """A server that closes connections without a request, and ends within `ServeConfig.grace`."""

    def __init__(self, app: "FastAPI", config: ServeConfig) -> None:
        # uvicorn's own limit of connections would count the silent ones and refuse all others.
        super().__init__(uvicorn.Config(app, log_level="warning"))
        self._grace = config.grace
        # Connections without a request, with their last request and the time when it was over.
        self._silent: dict[Any, tuple[Any, float]] = {}

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin the end; a second signal, or the end of the grace period, ends the process."""
        if self.should_exit:
            self._cut_off(sig)
        # uvicorn's own limit cancels the frames, with a traceback for each.
        limit = threading.Timer(self._grace, self._cut_off, [sig])
        limit.daemon = True
        limit.start()
        super().handle_exit(sig, frame)

    async def on_tick(self, counter: int) -> bool:
        """Close connections that have been silent for too long, or are too many; every 0.1 s."""
        now, before = time.monotonic(), self._silent
        self._silent = {}
        for each in self.server_state.connections:
            cycle = getattr(each, "cycle", None)  # the last request and its answer
            if cycle is None or cycle.response_complete:
                last, since = before.get(each, (cycle, now))
                self._silent[each] = (cycle, since if last is cycle else now)
        too_many = len(self.server_state.connections) - MOST_CONNECTIONS
        longest_first = sorted(self._silent.items(), key=lambda item: item[1][1])
        for place, (connection, (_cycle, since)) in enumerate(longest_first):
            if place < too_many or now - since > LONGEST_SILENCE:
                connection.transport.close()
        return await super().on_tick(counter)

    async def shutdown(self, sockets: "list[socket] | None" = None) -> None:
        """Answer the posts that are complete, or soon will be, and close all connections."""
        asyncio.get_running_loop().call_later(LAST_UPLOADS, self._close_uploads)
        await super().shutdown(sockets)

    def _close_uploads(self) -> None:
        for each in list(self.server_state.connections):
            if getattr(getattr(each, "cycle", None), "more_body", False):
                each.transport.close()

    def _cut_off(self, number: int) -> None:
        set_farewell(f"frames in progress that take over {self._grace} s are lost")
        end_by_signal(number)
