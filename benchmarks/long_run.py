"""Memory and open handles of `serve` and `infer --watch` over a long time, at the same time.

`python -m benchmarks.long_run OUT --minutes 60 --pause 8`

Writes  OUT/long_run.csv  a row per minute and process: frames, megabytes, handles, threads
        OUT/long_run.md   medians of the first and last quarter, the first five minutes left out

Every `--pause` seconds a frame is posted and written into the watched folder: the bundled frames at
half size with noise in the depth, so that no two are equal. For `--backlog` minutes two frames are
written for each posted frame, which is more than `infer --watch` can process.
"""

import argparse
import csv
import itertools
import json
import subprocess
import sys
import time
import urllib.request
from base64 import b64encode
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import cv2
import numpy as np
import psutil

from benchmarks.bench_serve import wait_for
from pipelines.errors import errors_as_sentences
from pipelines.inference.models import WEIGHTS

PORT = 18767
SCALE = 0.5
NOISE = 0.002  # metres
WARM = 5.0  # minutes that the summary leaves out: compiled loops, caches
SAMPLE = 60.0  # seconds between samples
END = 300.0  # seconds that a command may take after SIGTERM, since it writes all grasps
BACKLOG_FRAMES = 2  # frames written for each posted frame


@dataclass(frozen=True)
class ResourceSample:
    """Resources of a process at one time."""

    minute: float
    command: str
    frames: int
    waiting: int  # frames written and not processed
    megabytes: float
    handles: int
    threads: int


@dataclass(frozen=True)
class PngFrame:
    """The files of a frame: colour and depth as PNG, and its camera."""

    color: bytes
    depth: bytes
    camera: dict[str, float]

    def posted(self) -> bytes:
        """Return the body of a post."""
        color, depth = (b64encode(data).decode() for data in (self.color, self.depth))
        return json.dumps({"color": color, "depth": depth, "intrinsics": self.camera}).encode()

    def write(self, folder: Path, name: str) -> None:
        """Write the frame's files, the depth last."""
        (folder / f"{name}_camera.json").write_text(json.dumps(self.camera), encoding="utf-8")
        (folder / f"{name}_color.png").write_bytes(self.color)
        (folder / f"{name}_depth.png").write_bytes(self.depth)


def frames(seed: int = 0) -> Iterator[PngFrame]:
    """Yield frames without end, no two equal."""
    rng, folder = np.random.default_rng(seed), WEIGHTS / "frames"
    names = sorted(path.name.removesuffix("_depth.png") for path in folder.glob("*_depth.png"))
    while True:
        for name in names:
            camera = json.loads((folder / f"{name}_camera.json").read_text(encoding="utf-8"))
            depth = cv2.imread(str(folder / f"{name}_depth.png"), cv2.IMREAD_UNCHANGED)
            color = cv2.imread(str(folder / f"{name}_color.png"))
            yield _smaller(color, depth, camera, rng)


def _smaller(
    color: np.ndarray, depth: np.ndarray, camera: dict[str, float], rng: np.random.Generator
) -> PngFrame:
    height, width = (round(SCALE * side) for side in depth.shape)
    depth = cv2.resize(depth, (width, height), interpolation=cv2.INTER_NEAREST)
    noise = rng.normal(0, NOISE * camera["depth_scale"], depth.shape)
    depth = np.where(depth > 0, np.clip(depth + noise, 1, 65535), 0).astype(np.uint16)
    color = cv2.resize(color, (width, height), interpolation=cv2.INTER_AREA)
    scaled = {name: SCALE * camera[name] for name in ("fx", "fy", "cx", "cy")}
    scaled |= {"width": width, "height": height, "depth_scale": camera["depth_scale"]}
    color_png, depth_png = (cv2.imencode(".png", each)[1].tobytes() for each in (color, depth))
    return PngFrame(color_png, depth_png, scaled)


def run(out: Path, minutes: float, pause: float, backlog: float = 0.0) -> list[ResourceSample]:
    """Feed both commands for `minutes`; write and return all samples."""
    watched = out / "frames"
    watched.mkdir(parents=True)
    commands = {
        "serve": ["serve", "--port", str(PORT)],
        "infer --watch": ["infer", str(watched), "--out", str(out / "grasps.h5"), "--watch"],
    }
    running = {}
    try:
        for name, words in commands.items():
            command = [sys.executable, "-m", "symgrasp", *words]
            with (out / f"{words[0]}.log").open("wb") as log:
                running[name] = subprocess.Popen(command, stdout=log, stderr=log)
        wait_for(running["serve"], PORT)
        return _fed(running, out, minutes, pause, backlog)
    finally:
        for process in running.values():
            process.terminate()
        for name, process in running.items():
            sys.stdout.write(f"{name} ended with {process.wait(END)}\n")


def _fed(
    running: "dict[str, subprocess.Popen[bytes]]",
    out: Path,
    minutes: float,
    pause: float,
    backlog: float,
) -> list[ResourceSample]:
    samples: list[ResourceSample] = []
    made, written, posted = frames(), 0, 0
    started = sampled = time.monotonic()
    while (began := time.monotonic()) - started <= 60 * minutes:
        each = BACKLOG_FRAMES if began - started < 60 * backlog else 1
        for frame in itertools.islice(made, each):
            frame.write(out / "frames", f"f{written:06d}")
            written += 1
        _post(frame.posted())
        posted += 1
        ended = [name for name, process in running.items() if process.poll() is not None]
        if ended:
            raise SystemExit(f"{ended[0]} has ended; its log is in {out}")
        if time.monotonic() - sampled >= SAMPLE:
            sampled = time.monotonic()
            done = len(list(out.glob("*.parts/*.h5")))
            counts = {"serve": (posted, 0), "infer --watch": (done, written - done)}
            minute = (sampled - started) / 60
            samples += [_sample(minute, n, *counts[n], p.pid) for n, p in running.items()]
            write_samples(out, samples)
        time.sleep(max(0.0, pause - (time.monotonic() - began)))
    return samples


def _post(body: bytes) -> None:
    head = {"Content-Type": "application/json"}
    request = urllib.request.Request(f"http://127.0.0.1:{PORT}/grasps", body, head)
    with urllib.request.urlopen(request, timeout=300) as answer:
        answer.read()


def _sample(minute: float, name: str, count: int, waiting: int, process: int) -> ResourceSample:
    seen = psutil.Process(process)
    tree = [seen, *seen.children(recursive=True)]
    memory = sum(each.memory_info().rss for each in tree) / 1e6
    handles = sum(each.num_fds() for each in tree)
    threads = sum(each.num_threads() for each in tree)
    return ResourceSample(
        round(minute, 2), name, count, waiting, round(memory, 1), handles, threads
    )


def write_samples(out: Path, samples: Sequence[ResourceSample]) -> None:
    """Write the table of all samples and its summary."""
    with (out / "long_run.csv").open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow([field.name for field in fields(ResourceSample)])
        writer.writerows(astuple(sample) for sample in samples)
    (out / "long_run.md").write_text(resource_summary(samples), encoding="utf-8")


def resource_summary(samples: Sequence[ResourceSample]) -> str:
    """Return medians of the first and the last quarter of each command, as a Markdown table."""
    lines = [
        "| command | frames | minutes | MB, first quarter | MB, last quarter | MB at most "
        "| handles, first | handles, last | threads, first | threads, last | waiting at most |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name in dict.fromkeys(sample.command for sample in samples):
        own = [each for each in samples if each.command == name and each.minute >= WARM]
        if len(own) < 4:
            continue
        quarter = len(own) // 4
        cells = [f"`{name}`", own[-1].frames, round(own[-1].minute)]
        for kind in ("megabytes", "handles", "threads"):
            values = [getattr(each, kind) for each in own]
            cells += [f"{np.median(part):.0f}" for part in (values[:quarter], values[-quarter:])]
            if kind == "megabytes":
                cells.append(f"{max(values):.0f}")
        cells.append(max(each.waiting for each in own))
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines) + "\n"


@errors_as_sentences()
def main(arguments: Sequence[str] | None = None) -> None:
    """Run both commands, then print the summary."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.long_run",
        description="Memory and handles of `serve` and `infer --watch` over a long time.",
    )
    parser.add_argument("out", type=Path, help="folder that does not exist")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--pause", type=float, default=8.0, help="seconds from frame to frame")
    parser.add_argument(
        "--backlog", type=float, default=0.0, help="minutes with more frames than can be processed"
    )
    given = parser.parse_args(arguments)
    sys.stdout.write(resource_summary(run(given.out, given.minutes, given.pause, given.backlog)))


if __name__ == "__main__":
    main()
