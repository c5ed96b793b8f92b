"""Grasps of all frames of a folder, models loaded once: OUT/NAME.json, gripper poses and openings.

    python folder_loop.py my_frames --out grasps --gripper franka

The folder holds `NAME_color.png`, `NAME_depth.png` (16 bit) and `NAME_camera.json`, or one
`camera.json` for all frames (`fx`, `fy`, `cx`, `cy`, `depth_scale`). `symgrasp infer` reads many
other layouts and resumes after a kill; your own loop is useful if each frame needs further work.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from symgrasp import GraspDetector, Grasps, SymgraspError


def grasps_in(color_path: Path, detector: GraspDetector) -> Grasps:
    """Return the grasps of the frame with the colour image `color_path`."""
    stem = str(color_path).removesuffix("_color.png")
    color = np.asarray(Image.open(color_path).convert("RGB"))
    depth = np.asarray(Image.open(f"{stem}_depth.png"))
    own, shared = Path(f"{stem}_camera.json"), color_path.with_name("camera.json")
    camera = (own if own.exists() else shared).read_text(encoding="utf-8")
    return detector(color, depth, json.loads(camera))


def as_json(grasps: Grasps) -> str:
    """Return the poses of the gripper's base in the camera frame, metres, best first."""
    return json.dumps(
        {
            "gripper": grasps.gripper.name,
            "poses": grasps.poses().round(6).tolist(),
            "openings": grasps.opening.round(6).tolist(),
            "rank_scores": grasps.rank_score.tolist(),
            "worth_trying": grasps.worth_trying.tolist(),
        }
    )


def main(arguments: list[str] | None = None) -> None:
    """Write a file for each frame; exit with 1 if a frame has none."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("frames", type=Path)
    parser.add_argument("--out", type=Path, default=Path("grasps"))
    parser.add_argument("--gripper", default="rg2")
    options = parser.parse_args(arguments)
    color_paths = sorted(options.frames.glob("*_color.png"))
    if not color_paths:
        parser.error(f"{options.frames} holds no NAME_color.png")
    options.out.mkdir(parents=True, exist_ok=True)
    detector = GraspDetector(options.gripper)
    failed = False
    for color_path in color_paths:
        name = color_path.name.removesuffix("_color.png")
        try:
            grasps = grasps_in(color_path, detector)
        except (SymgraspError, OSError, ValueError) as error:
            print(f"{name}: {error}")
            failed = True
            continue
        (options.out / f"{name}.json").write_text(as_json(grasps), encoding="utf-8")
        print(f"{name}: {len(grasps)} grasps {grasps.message}".rstrip())
    if failed:
        sys.exit(1)


if __name__ == "__main__":
    main()
