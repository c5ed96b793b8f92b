"""The HTTP application: `POST /grasps` returns the grasps of a frame, `GET /health` counts."""

import logging
import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import anyio
from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse, Response
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from pipelines.configs import ServeConfig
from pipelines.errors import SymgraspError, counted
from pipelines.serving.posted_frames import PostedFrame, posted_frame

Answer = Callable[[PostedFrame], str]  # the JSON text of a frame's grasps
JSON_TYPE = "application/json"
DISCARDED = 4  # bodies of this many times the largest size are received, then refused
GONE = "the client has gone"
LONGEST_SILENCE = 20.0  # seconds without a part of a body until its post is refused
LONGEST_BODY = 60.0  # seconds for all of a body, which may come a byte at a time
LATEST = 0.2  # weight of the latest frame in the mean time of a frame
log = logging.getLogger(__name__)


@dataclass
class FrameTimes:
    """Expected times of frames.

    Attributes:
        parallel: frames processed at a time.
        mean: running mean of the seconds of a frame; 0 before the first.
    """

    parallel: int
    mean: float = 0.0

    def note(self, seconds: float) -> None:
        """Add the time of a frame to the mean."""
        self.mean += (LATEST if self.mean else 1.0) * (seconds - self.mean)

    def until_answer(self, ahead: int) -> float:
        """Return the expected seconds until the answer to a post behind `ahead` others.

        0 if it is processed at once: a post that does not wait is never refused.
        """
        return 0.0 if ahead < self.parallel else self.mean * (ahead // self.parallel + 1)


def make_app(answer: Answer, facts: dict[str, Any], config: ServeConfig) -> FastAPI:
    """Return the application.

    Args:
        answer: returns the grasps of a frame; called from several threads.
        facts: content of `/health` in addition to the counts.
        config: limits of the server.
    """
    app = FastAPI(
        title="SymGrasp", docs_url=None, redoc_url=None, openapi_url=None, redirect_slashes=False
    )
    # Numbers of frames so far; only the thread of the event loop changes them.
    counts = {"answered": 0, "refused": 0, "waiting": 0}
    limiter, times = anyio.CapacityLimiter(config.parallel), FrameTimes(config.parallel)

    @app.get("/health")
    @app.head("/health")
    def health() -> dict[str, Any]:
        return {"status": "ok", **facts, **counts}

    @app.post("/grasps")
    async def grasps(request: Request) -> Response:
        waiting, expected = counts["waiting"], times.until_answer(counts["waiting"])
        if waiting >= config.max_waiting or expected > config.max_wait:
            counts["refused"] += 1
            later = math.ceil(max(1.0, times.mean, expected - config.max_wait))
            ahead = counted(waiting, "frame")
            sentence = f"the server has {ahead} to answer first; post again in {later} s"
            most, head = DISCARDED * config.max_bytes, {"Retry-After": str(later)}
            return await _refused_unread(request, 503, sentence, most, head)
        counts["waiting"] += 1
        try:
            response = await _answered(request, answer, limiter, times, config)
        finally:
            counts["waiting"] -= 1
        counts["answered" if response.status_code == 200 else "refused"] += 1
        return response

    @app.exception_handler(HTTPException)
    async def elsewhere(request: Request, error: HTTPException) -> Response:
        asked = f"{request.method} {request.url.path}"
        sentence = f"{asked} is not answered; POST /grasps and GET /health are"
        return _refusal(error.status_code, sentence, error.headers)

    return app


async def _answered(
    request: Request,
    answer: Answer,
    limiter: anyio.CapacityLimiter,
    times: FrameTimes,
    config: ServeConfig,
) -> Response:
    """Return the grasps of the posted frame, or one sentence about its fault."""
    # Another type would let any web page that the user visits post here.
    posted_type = request.headers.get("content-type", "").partition(";")[0].strip()
    if posted_type.lower() != JSON_TYPE:
        sentence = f"the Content-Type is {posted_type[:80] or 'not given'}; it must be {JSON_TYPE}"
        return await _refused_unread(request, 415, sentence, DISCARDED * config.max_bytes)
    body = await _received(request, config)
    if isinstance(body, Response):
        return body

    def work() -> str:
        return answer(posted_frame(body, config.max_pixels))

    try:
        async with limiter:
            if await _has_gone(request):
                return _refusal(400, GONE)
            started = anyio.current_time()
            text = await anyio.to_thread.run_sync(work, limiter=anyio.CapacityLimiter(1))
            times.note(anyio.current_time() - started)
    except SymgraspError as error:
        return _refusal(400, str(error))
    except Exception:
        log.exception("a frame could not be answered")
        return _refusal(500, "the server failed on this frame; its log says why")
    return Response(text, media_type=JSON_TYPE)


async def _received(request: Request, config: ServeConfig) -> bytes | Response:
    """Return the body of a request, or one sentence about why there is none."""
    try:
        body = await _body(request, config.max_bytes, DISCARDED * config.max_bytes)
    except TimeoutError:
        limits = f"no part of it for {LONGEST_SILENCE:g} s, or not all within {LONGEST_BODY:g} s"
        sentence = f"the rest of the body did not come ({limits}); post again"
        return _refusal(408, sentence, {"Connection": "close"})
    except ClientDisconnect:
        return _refusal(400, GONE)
    if body is None:
        return _refusal(413, f"the body is larger than {config.max_bytes} bytes")
    return body


async def _body(request: Request, most: int, received: int) -> bytes | None:
    """Return the body of a request; None if it is larger than `most` bytes.

    Up to `received` bytes are received and forgotten: most clients send all of a body before they
    read the answer, and an earlier answer would be a broken pipe to them.

    Raises:
        TimeoutError: no part came for `LONGEST_SILENCE` seconds, or not all in `LONGEST_BODY`.
        ClientDisconnect: the client has gone.
    """
    declared = request.headers.get("content-length", "0")
    if declared.isdecimal() and int(declared) > received:
        return None
    parts: list[bytes] = []
    size = 0
    end = anyio.current_time() + LONGEST_BODY
    with anyio.fail_after(min(LONGEST_SILENCE, LONGEST_BODY)) as limit:
        async for part in request.stream():
            limit.deadline = min(anyio.current_time() + LONGEST_SILENCE, end)
            size += len(part)
            if size > received:
                return None
            if size <= most:
                parts.append(part)
            else:
                parts.clear()
    return b"".join(parts) if size <= most else None


async def _has_gone(request: Request) -> bool:
    """Return whether the client has closed its connection, as after a time-out of its own."""
    await request.is_disconnected()  # uvicorn reads on, which it does not after a large body
    await anyio.sleep(0.01)  # it reads the end of the connection
    return await request.is_disconnected()


async def _refused_unread(
    request: Request,
    status: int,
    sentence: str,
    received: int,
    headers: Mapping[str, str] | None = None,
) -> Response:
    with suppress(ClientDisconnect, TimeoutError):
        await _body(request, 0, received)
    return _refusal(status, sentence, headers)


def _refusal(status: int, sentence: str, headers: Mapping[str, str] | None = None) -> JSONResponse:
    return JSONResponse({"error": sentence}, status_code=status, headers=headers)
