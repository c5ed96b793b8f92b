"""Draw the README's figures from the code itself: `python tools/figures.py` writes docs/images/."""

from pathlib import Path

import numpy as np

from pipelines.grasp_files.gripper_files import load_gripper, preset_names
from pipelines.grasping.gripper import Gripper

FOLDER = Path(__file__).parents[1] / "docs" / "images"
BLUE, RED, GREEN, GREY, INK = "#2563a8", "#c0392b", "#2e8b57", "#8a8f98", "#1f2430"
FONT = 'font-family="DejaVu Sans, Helvetica, Arial, sans-serif"'
SCALE = 1100.0  # pixels per metre of the grippers

STAGES = (
    ("synthesize", "objects, scenes, RGB-D, labels", "ROOT/models, scenes, grasp_label"),
    ("annotate-symmetry", "planes, axes, spheres, regions", "ROOT/symmetry/NNN.json"),
    ("refine-grasps", "mirror and revolve the labels", "ROOT/affordance/NNN.h5"),
    ("pack", "region clouds with labels", "PACKED/scene_XXXX.h5"),
    ("finetune-detector", "Mask R-CNN on region masks", "detector.safetensors"),
    ("train", "PointNet++ with PIFT, Siamese", "network.safetensors"),
    ("inspect", "check frames before a run", "layout, camera, unit, oddities"),
    ("infer", "frames in, grasps out", "grasps.h5, overlays"),
    ("view", "a 3D page for each frame", "PAGES/FRAME.html"),
    ("export", "for the next program", "GraspNet, Isaac, ROS, JSON, CSV"),
    ("simulate", "lift and tug in simulation", "success.json"),
    ("evaluate", "quality, antipodal, symmetry AP", "report.json, report.html"),
    ("compare", "runs side by side, with intervals", "compare.json, compare.html"),
)


def document(width: float, height: float, body: list[str]) -> str:
    """Return an SVG document with a white background."""
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" {FONT}>'
    ground = f'<rect width="{width:g}" height="{height:g}" fill="white"/>'
    return "\n".join([head, ground, *body, "</svg>"]) + "\n"


def text(x: float, y: float, content: str, *, size: float, color: str, anchor: str) -> str:
    """Return one line of text."""
    return (
        f'<text x="{x:g}" y="{y:g}" font-size="{size:g}" fill="{color}" '
        f'text-anchor="{anchor}">{content}</text>'
    )


def stages_figure() -> str:
    """Return the stages as boxes from top to bottom, with their outputs next to arrows."""
    body, height, step = [], 40.0, 62.0
    for row, (name, summary, writes) in enumerate(STAGES):
        y = 14.0 + row * step
        body.append(
            f'<rect x="20" y="{y:g}" width="300" height="{height:g}" rx="7" '
            f'fill="#eef3f9" stroke="{BLUE}" stroke-width="1.4"/>'
        )
        body.append(text(34, y + 17, f"symgrasp {name}", size=13.5, color=INK, anchor="start"))
        body.append(text(34, y + 33, summary, size=11, color=GREY, anchor="start"))
        body.append(
            f'<line x1="322" y1="{y + 20:g}" x2="352" y2="{y + 20:g}" stroke="{BLUE}" '
            f'stroke-width="1.4" marker-end="url(#tip)"/>'
        )
        body.append(text(360, y + 24, writes, size=12, color=INK, anchor="start"))
        if row + 1 < len(STAGES):
            body.append(
                f'<line x1="170" y1="{y + height + 2:g}" x2="170" y2="{y + step - 5:g}" '
                f'stroke="{GREY}" stroke-width="1.2" marker-end="url(#tip)"/>'
            )
    return document(640, 24 + len(STAGES) * step, [arrow_tip(INK), *body])


def arrow_tip(color: str, name: str = "tip") -> str:
    """Return the marker at the end of arrows."""
    return (
        f'<defs><marker id="{name}" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="6" '
        f'markerHeight="6" orient="auto"><path d="M0 0 L8 4 L0 8 z" fill="{color}"/></marker>'
        "</defs>"
    )


def projected(points: np.ndarray) -> np.ndarray:
    """Return the (n, 2) pixels of `points` (n, 3), grasp frame, seen obliquely from the side."""
    # Approach runs down the page, closing to the right, the binormal towards the reader.
    right = np.array([0.10, 0.96, -0.27])
    down = np.array([0.97, -0.04, 0.22])
    return np.stack([points @ right, points @ down], -1) * 3300.0 + [330.0, 372.0]


def box_outline(low: np.ndarray, high: np.ndarray) -> list[str]:
    """Return the visible faces of a box as polygons, far faces first."""
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    pixels = projected(low + corner * (high - low))
    faces = ((0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
    drawn = []
    for face in faces:
        points = " ".join(f"{pixels[i, 0]:.1f},{pixels[i, 1]:.1f}" for i in face)
        drawn.append(
            f'<polygon points="{points}" fill="#d7dde6" fill-opacity="0.75" stroke="{GREY}" '
            f'stroke-width="1"/>'
        )
    return drawn


def arrow(
    start: np.ndarray, end: np.ndarray, color: str, label: str, shift: tuple[int, int]
) -> str:
    """Return a labelled arrow between two points of the grasp frame."""
    (x1, y1), (x2, y2) = projected(np.stack([start, end]))
    name = color.strip("#")
    line = (
        f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{color}" '
        f'stroke-width="3" marker-end="url(#{name})"/>'
    )
    caption = text(x2 + shift[0], y2 + shift[1], label, size=15, color=color, anchor="start")
    return arrow_tip(color, name) + line + caption


def frame_figure() -> str:
    """Return the grasp frame: gripper, contacts, the three axes."""
    width, origin = 0.05, np.zeros(3)
    body = []
    boxes = load_gripper("rg2").boxes(width)
    for low, high in (boxes[2], boxes[0], boxes[1]):
        body += box_outline(low, high)
    center = projected(origin[None])[0]
    contacts = projected(np.array([[0, -width / 2, 0], [0, width / 2, 0]]))
    body.append(
        f'<ellipse cx="{center[0]:.1f}" cy="{center[1] + 16:.1f}" rx="82" ry="62" '
        f'fill="#f6e7c8" stroke="#b58b3c" fill-opacity="0.8"/>'
    )
    body += [
        arrow(origin, np.array([0.035, 0, 0]), RED, "approach: 1st column", (8, 6)),
        arrow(origin, np.array([0, 0.05, 0]), GREEN, "closing: 2nd column", (8, 5)),
        arrow(origin, np.array([0, 0, 0.045]), BLUE, "approach x closing", (-150, 12)),
    ]
    body += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{INK}"/>' for x, y in contacts]
    body.append(f'<circle cx="{center[0]:.1f}" cy="{center[1]:.1f}" r="5" fill="{RED}"/>')
    notes = (
        "translation = midpoint of the two contacts (red dot)",
        "width = distance between the contacts (black dots)",
        "opening = width + clearance of the gripper on each side",
    )
    body += [
        text(20, 552 + 20 * i, n, size=14, color=INK, anchor="start") for i, n in enumerate(notes)
    ]
    return document(700, 612, body)


def grippers_figure() -> str:
    """Return every preset, open, to one scale: from the front and from the side."""
    body, column, top = [], 330.0, 90.0
    for place, name in enumerate(preset_names()):
        gripper, left = load_gripper(name), 20.0 + place * column
        boxes = gripper.boxes(gripper.max_width)
        middle, tips = left + 120.0, top + SCALE * (gripper.finger_length + gripper.palm_depth)
        body.append(text(left, 28, name, size=17, color=INK, anchor="start"))
        body += [
            text(left, 48 + 17 * row, each, size=12, color=GREY, anchor="start")
            for row, each in enumerate(_measures(gripper))
        ]
        body += _views(boxes, middle, left + 275.0, tips)
    width, low = 20.0 + len(preset_names()) * column, 90.0 + SCALE * 0.11 + 46.0
    body.append(
        f'<line x1="20" y1="{low:g}" x2="{20 + 0.05 * SCALE:g}" y2="{low:g}" '
        f'stroke="{INK}" stroke-width="3"/>'
    )
    body.append(text(28 + 0.05 * SCALE, low + 4, "5 cm", size=12, color=INK, anchor="start"))
    note = "red: the line of the contacts; right of each gripper: the same from the side"
    body.append(text(width - 20, low + 4, note, size=12, color=GREY, anchor="end"))
    return document(width, low + 18, body)


def _measures(gripper: Gripper) -> tuple[str, str]:
    """Return the text over a gripper: its measures in millimetres."""
    opening, widest, flange = (
        1000 * each for each in (gripper.max_opening, gripper.max_width, gripper.flange_to_tip)
    )
    return (
        f"opens {opening:.0f} mm, contacts up to {widest:.0f} mm apart",
        f"flange to finger tips {flange:.0f} mm",
    )


def _views(boxes: np.ndarray, front: float, side: float, tips: float) -> list[str]:
    """Return the `boxes` (3, 2, 3) of a gripper about two vertical lines, tips at height `tips`."""
    drawn = []
    tip = boxes[0, 1, 0]
    for axis, middle in ((1, front), (2, side)):
        for low, high in boxes[::-1]:
            corner = tips + SCALE * (low[0] - tip), middle + SCALE * low[axis]
            height, width = SCALE * (high[0] - low[0]), SCALE * (high[axis] - low[axis])
            drawn.append(
                f'<rect x="{corner[1]:.1f}" y="{corner[0]:.1f}" width="{width:.1f}" '
                f'height="{height:.1f}" fill="#d7dde6" stroke="{GREY}"/>'
            )
    line = tips - SCALE * tip
    reach = SCALE * (boxes[1, 0, 1] - boxes[0, 1, 1]) / 2
    drawn.append(
        f'<line x1="{front - reach:.1f}" y1="{line:.1f}" x2="{front + reach:.1f}" '
        f'y2="{line:.1f}" stroke="{RED}" stroke-width="1.5" stroke-dasharray="5 4"/>'
    )
    return drawn


if __name__ == "__main__":
    (FOLDER / "grippers.svg").write_text(grippers_figure(), encoding="utf-8")
    (FOLDER / "stages.svg").write_text(stages_figure(), encoding="utf-8")
    (FOLDER / "grasp_frame.svg").write_text(frame_figure(), encoding="utf-8")
