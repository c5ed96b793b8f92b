"""The page in a real browser, where there is one: drawing, turning, and clicks."""

import base64
import json
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from pipelines.configs import ViewConfig
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.pictures.grasp_page.page import HERE, frame_page
from pipelines.pictures.grasp_page.scene import frame_scene
from pipelines.storage.provenance import make_stamp
from tests.geometry.tabletops import CAMERA
from tests.pictures.grasp_page.toys import toy_frame, toy_result

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
NODE = shutil.which("node")
SCRIPTS = ("vectors.js", "drawing.js", "content.js")
FLAGS = (
    "--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--enable-logging=stderr", "--window-size=900,600",
    "--virtual-time-budget=20000",
)  # fmt: skip
FRAME, INDEX = toy_frame()
GRIPPER = load_gripper("rg2")
# Imitates a person, and then writes the state of the page as the text of an element.
VISITOR = """
const outcome = {errors: [], hits: [], facts: {}};
addEventListener("error", (event) => outcome.errors.push(event.message));
const by = (id) => document.getElementById(id), view = by("view");
const key = (name) => document.dispatchEvent(new KeyboardEvent("keydown", {key: name}));
const pointer = (kind, x, y, buttons) => view.dispatchEvent(
  new PointerEvent(kind, {pointerId: 1, clientX: x, clientY: y, buttons, bubbles: true}));
const facts = () => [...by("picked").querySelectorAll("dd")].map((each) => each.textContent);
setTimeout(() => {
  outcome.trouble = by("trouble").hidden ? "" : by("trouble").textContent;
  outcome.regions = by("regions").children.length;
  outcome.most = by("count").max;
  const area = view.getBoundingClientRect(), hits = new Set();
  for (let y = 5; y < area.height; y += 20) {
    for (let x = 5; x < area.width; x += 20) {
      pointer("pointerdown", area.left + x, area.top + y, 1);
      pointer("pointerup", area.left + x, area.top + y, 0);
      view.dispatchEvent(new MouseEvent("click", {clientX: area.left + x, clientY: area.top + y}));
      if (!by("picked").hidden) hits.add(facts().join("|"));
    }
  }
  outcome.hits = [...hits];
  key("Escape");
  outcome.hidden = by("picked").hidden;
  for (const name of ["n", "t", "r", "+", "+", "g", "g", "s", "p", "ArrowLeft"]) key(name);
  outcome.shown = by("count").value;
  pointer("pointerdown", 500, 300, 1);
  pointer("pointermove", 560, 320, 1);
  pointer("pointerup", 560, 320, 0);
  view.dispatchEvent(new WheelEvent("wheel", {deltaY: -200, cancelable: true}));
  key("p");
  key("s");
  key("c");
  requestAnimationFrame(() => {  // behind the page's own: what it has just drawn is still there
    outcome.picture = view.toDataURL();
    const made = document.createElement("pre");
    made.id = "outcome";
    made.textContent = JSON.stringify(outcome);
    document.body.append(made);
    made.hidden = true;
  });
}, 500);
"""


def page_for(folder: Path, grasps: int) -> Path:
    result = toy_result(FRAME, INDEX, grasps)
    scene = frame_scene(FRAME, result, GRIPPER, ViewConfig())
    text = frame_page(scene, result, make_stamp("view", {}))
    path = folder / "page.html"
    path.write_text(text.replace("</body>", f"<script>{VISITOR}</script></body>"), encoding="utf-8")
    return path


def browse(page: Path, *flags: str) -> subprocess.CompletedProcess[str]:
    if CHROMIUM is None:
        pytest.skip("no Chromium is installed")
    command = [
        CHROMIUM,
        *FLAGS,
        f"--user-data-dir={page.parent / 'profile'}",
        *flags,
        page.as_uri(),
    ]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


def visited(page: Path) -> dict:
    for _ in range(3):  # on a busy machine the time may be over before the page has drawn
        done = browse(page, "--dump-dom")
        found = re.search(r'<pre id="outcome"[^>]*>(.*?)</pre>', done.stdout, re.DOTALL)
        if found is not None:
            break
    if found is None and "<html" not in done.stdout:
        pytest.skip("Chromium does not start here")
    assert found is not None, done.stderr
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return json.loads(found[1].replace("&gt;", ">").replace("&lt;", "<")) | {"console": console}


def test_clicked_grasps_show_their_figures(tmp_path):
    outcome = visited(page_for(tmp_path, 5))
    assert (outcome["errors"], outcome["console"], outcome["trouble"]) == ([], [], "")
    assert (outcome["regions"], outcome["most"], outcome["shown"]) == (2, "3", "3")
    assert outcome["hidden"]
    best = toy_result(FRAME, INDEX).grasps
    rows = np.flatnonzero(best.is_best)
    facts = {text.split("|")[2][0]: text.split("|") for text in outcome["hits"]}
    assert sorted(facts) == ["0", "1"]  # only the best of each region is shown
    for row in rows:
        score, rank, region, source, symmetry, width, *_ = facts[str(best.region[row])]
        assert score.partition(",")[0] == f"{best.rank_score[row]:.4f}"
        assert rank.startswith(str(row))  # scores fall from row to row
        assert region.endswith("(best)")
        assert source == best.source[row]
        assert symmetry.startswith("rotation axis, confidence 0.80" if row == 0 else "none")
        assert width == f"{1000 * best.width[row]:.1f} mm"


def test_without_grasps_and_from_the_camera_the_page_shows_the_photograph(tmp_path):
    outcome = visited(page_for(tmp_path, 0))
    assert (outcome["errors"], outcome["console"], outcome["trouble"]) == ([], [], "")
    assert (outcome["hits"], outcome["most"]) == ([], "0")
    picture = np.frombuffer(base64.b64decode(outcome["picture"].partition(",")[2]), np.uint8)
    seen = cv2.imdecode(picture, cv2.IMREAD_COLOR)[..., ::-1].astype(float)
    high, wide = seen.shape[:2]
    # The picture fills the canvas across or from top to bottom, the optical axis in the middle.
    scale = min(wide / CAMERA.width, high / CAMERA.height)
    rows, columns = np.nonzero(cv2.erode((FRAME.depth > 0).astype(np.uint8), np.ones((9, 9))))
    x = wide / 2 + (columns - CAMERA.cx) * scale
    y = high / 2 + (rows - CAMERA.cy) * scale
    drawn = seen[np.round(y - 0.5).astype(int), np.round(x - 0.5).astype(int)]
    off = np.abs(drawn - FRAME.color[rows, columns])
    far = INDEX[rows, columns] < 0  # regions are tinted
    assert np.percentile(off[far], 95) < 6  # other pixels are beneath symmetries
    assert np.median(off[far]) <= 1


def answered(folder: Path, names: Sequence[str], ask: str) -> Any:
    """Return what `ask`, behind the page's scripts of these `names`, prints as JSON."""
    scripts = "\n".join((HERE / name).read_text(encoding="utf-8") for name in names)
    (folder / "ask.js").write_text(f"{scripts}\n{ask}", encoding="utf-8")
    command = [str(NODE), str(folder / "ask.js")]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


@pytest.mark.skipif(NODE is None, reason="no node is installed")
@pytest.mark.parametrize("center", [(159.5, 119.5), (220.0, 60.0), (90.0, 200.0), (-40.0, 119.5)])
def test_the_cameras_view_just_holds_the_picture_wherever_its_optical_axis_is(tmp_path, center):
    camera = {"fx": 260.0, "fy": 300.0, "columns": 320, "rows": 240}
    camera |= {"cx": center[0], "cy": center[1]}
    scene = {"camera": camera, "up": [0, -1, 0], "focus": {"place": [0, 0, 1], "radius": 0.2}}
    aspects = [0.6, 1.0, 1.6, 2.5]
    ask = f"""
    const view = standardViews({json.dumps(scene)}).camera;
    const matrices = {aspects}.map((aspect) => {{
      const {{ eye, target, up, fovy }} = view(aspect);
      return Array.from(product(perspective(fovy, aspect, 0.01, 60), lookAt(eye, target, up)));
    }});
    console.log(JSON.stringify(matrices));
    """
    u, v = np.meshgrid([-0.5, camera["columns"] - 0.5], [-0.5, camera["rows"] - 0.5])
    x, y = (u - center[0]) / camera["fx"], (v - center[1]) / camera["fy"]
    corners = np.stack([x, y, np.ones_like(x), np.ones_like(x)], -1).reshape(4, 4)
    for matrix in answered(tmp_path, ("vectors.js", "orbit.js"), ask):
        seen = corners @ np.reshape(matrix, (4, 4))
        assert np.abs(seen[:, :2] / seen[:, 3:]).max() == pytest.approx(1.0, abs=1e-5)


@pytest.mark.skipif(NODE is None, reason="no node is installed")
def test_grippers_and_rays_of_the_scripts_equal_those_of_python(tmp_path):
    table = toy_result(FRAME, INDEX).grasps
    grasp = {
        "rotation": table.rotation[1].ravel().tolist(),
        "translation": table.translation[1].tolist(),
        "boxes": GRIPPER.boxes(table.width[1]).tolist(),
    }
    ask = f"""
    const grasp = {json.dumps(grasp)}, into = {{solid: [], lines: [], sheets: []}};
    gripper(into, grasp, [1, 0, 0], 1);
    const corners = [];
    for (let i = 0; i < into.solid.length; i += VERTEX) corners.push(into.solid.slice(i, i + 3));
    const eye = [0.3, -0.2, 0.1], place = [0.1, 0.2, 0.9];
    const clip = product(perspective(0.8, 1.5, 0.01, 60), lookAt(eye, place, [0, -1, 0]));
    console.log(JSON.stringify({{corners, clip: Array.from(clip),
      box: meetsBox([0, 0, -2], [0, 0, 1], [-1, -1, 1], [1, 1, 3]),
      miss: Number.isFinite(meetsBox([5, 0, -2], [0, 0, 1], [-1, -1, 1], [1, 1, 3])),
      turned: turned([1, 0, 0], [0, 0, 1], Math.PI / 2)}}));
    """
    printed = answered(tmp_path, SCRIPTS, ask)
    boxes = GRIPPER.boxes(table.width[1])
    wanted = {
        tuple(np.round(table.rotation[1] @ [x, y, z] + table.translation[1], 5))
        for box in boxes for x in box[:, 0] for y in box[:, 1] for z in box[:, 2]
    }  # fmt: skip
    drawn = {tuple(np.round(corner, 5)) for corner in np.array(printed["corners"])}
    assert len(printed["corners"]) == 3 * 36
    distance = [min(np.abs(np.subtract(a, b)).max() for b in wanted) for a in drawn]
    assert max(distance) < 2e-5
    assert len(wanted) == 24
    clip = np.array(printed["clip"]).reshape(4, 4).T @ [0.1, 0.2, 0.9, 1.0]
    assert np.abs(clip[:2] / clip[3]).max() < 1e-6  # the target of the view is in the middle
    assert (printed["box"], printed["miss"]) == (3, False)
    np.testing.assert_allclose(printed["turned"], [0, 1, 0], atol=1e-12)
