"""Small right inputs of every command, and the command lines that read them."""

import json
import shlex
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import trimesh

from pipelines.configs.stages import default_settings
from pipelines.configs.toml_files import as_toml
from pipelines.dataset.graspnet.graspnet import GraspNetRoot
from pipelines.dataset.meshes import write_mesh
from pipelines.dataset.symmetry import bop_models_info
from pipelines.geometry.meshes.mesh import Mesh
from tests.attacks.services import BAGS, POST, write_services
from tests.frames.layouts.build import LAYOUTS, K, color, depth
from tests.geometry.tabletops import Box
from tests.stages import dataset_root, toy_dump, toy_grasp_labels, toy_root
from tests.stages.test_infer import write_frame

Run = Callable[[Path, str], None]
PIPELINES = Path(__file__).parents[2] / "pipelines"
MIRROR = {"kind": "reflection", "normal": [1, 0, 0], "point": [0, 0, 0]}
EDITS = {
    "box": [
        {"drop": {"kind": "rotation", "index": 0}},
        {"fix": {"kind": "reflection", "index": 0, "point": [0, 0, 0.001]}},
    ]
}
REGIONS = {"regions": [{"name": "top", "box": [[-1, -1, 0], [1, 1, 1]], "symmetries": [MIRROR]}]}
ROS_CAMERA = """image_width: 48
image_height: 36
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: [60.0, 0.0, 23.5, 0.0, 61.0, 17.5, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.0, 0.0, 0.0, 0.0, 0.0]}
"""


@dataclass(frozen=True)
class Attack:
    """A command line, patterns of its inputs that are mutated, and its output.

    Attributes:
        line: the command line; paths are relative to the world.
        inputs: patterns of the files to mutate; one that stands twice is drawn twice as often.
        output: file or folder.
        share: how often the attack is drawn, relative to the others.
        small: whether its inputs exist in a world without the outputs of other commands.
    """

    line: str
    inputs: str
    output: str = "out"
    share: float = 1.0
    small: bool = False

    @property
    def words(self) -> tuple[str, ...]:
        """The command line's words."""
        return tuple(shlex.split(self.line))


SCENE = "root/symmetry/*.json root/scenes/scene_0100/**/*"
QUICK = "--set num_samples=500 --set num_verification_samples=200"
TUM = {"tum": "--intrinsics 60,61,23.5,17.5"}
ARRAYS = ("contact_graspnet", "six_dof_graspnet", "pcd", "flat", "bop_scene", "pickles")
FORMATS = {"graspnet": "", "contact-graspnet": "", "isaac": "", "json": ".json", "csv": ".csv"}
MESHES = ("box.obj", "box.stl", "box.off", "box.glb", "box.ply", "textured.obj")
WEIGHTS = ("axis-critic", "plane-critic", "grasp-critic", "network", "detector")
TRAINING = "--epochs 1 --max-seconds 1 --device cpu --threads 1"
PEER_TRAINING = "--split all --steps 1 --batch-size 1 --max-seconds 1 --device cpu --threads 1"
PEERS = {
    "gg-cnn": "labelled/scenes/**/rect/*",
    "multi-grasp": "labelled/scenes/**/rect/*",
    "pointnetgpd": "labelled/grasp_label/* labelled/collision_label/**/*",
    "graspnet": "labelled/grasp_label/* labelled/collision_label/**/*",
}

ATTACKS = (
    *(
        Attack(f"inspect frames/{name} {TUM.get(name, '')}", f"frames/{name}/**/*", small=True)
        for name in (*LAYOUTS, "yaml", "others")
    ),
    *(
        Attack(f"inspect frames/{name}", f"frames/{name}/**/*", share=2.0, small=True)
        for name in (*BAGS, "exr")
    ),
    Attack("convert-frames frames/compressed --out out", "frames/compressed/**/*", small=True),
    Attack("gripper from-urdf hand.urdf --out h.toml", "hand.urdf", "h.toml", 2.0, small=True),
    Attack("gripper check g.toml --picture out.png", "g.toml", "out.png", 2.0, small=True),
    Attack(f"{POST} post.json", "post.json", share=6.0),
    Attack("workspace table --out out", "table/*", share=2.0),
    Attack(
        "infer table --out out.h5 --method planar --regions geometric --device cpu --watch "
        "--watch-timeout 3",
        "table/*",
        "out.h5",
    ),
    Attack(
        "train-critic planes root --calibrate held --out out/c.safetensors --epochs 1 "
        "--max-seconds 1 --threads 1 --set infer.regions=geometric --frame-stride 2",
        SCENE,
        share=0.5,
    ),
    *(
        Attack(
            f"convert-frames frames/{name} --out out --trust-pickle",
            f"frames/{name}/**/*",
            small=True,
        )
        for name in ARRAYS
    ),
    *(
        Attack(
            f"export grasps.h5 --to {name} --out out{suffix} --gripper g.toml",
            "grasps.h5 grasps.h5 g.toml",
            f"out{suffix}",
            3.0,
            small=True,
        )
        for name, suffix in {**FORMATS, "ros-json": ""}.items()
    ),
    Attack(
        "score-grasps mesh/box.ply rows.npy --out out.npz",
        "mesh/box.ply rows.npy",
        "out.npz",
        2.0,
        small=True,
    ),
    Attack("config infer --config infer.toml", "infer.toml", share=3.0, small=True),
    Attack(
        "view grasps.h5 --out out --max-pixels 1000 --frames root",
        "grasps.h5 root/scenes/**/rgb/*",
        share=2.0,
    ),
    *(
        Attack(f"annotate-symmetry mesh/{name} --out out {QUICK}", f"mesh/{name}")
        for name in MESHES
    ),
    Attack(f"annotate-symmetry mesh/box.ply --out out {QUICK} --edit edits.json", "edits.json"),
    Attack(
        f"annotate-symmetry mesh/box.ply --out out {QUICK} --bop-symmetries bop.json", "bop.json"
    ),
    Attack("annotate-symmetry labels", "labels/symmetry/*.json", "labels/symmetry"),
    Attack("annotate-symmetry regions_root", "regions_root/regions/*.json", "regions_root"),
    Attack("label-grasps mesh/box.obj --out out --grasp-points 1 --no-sdf", "mesh/box.obj"),
    Attack(
        "refine-grasps labels --set num_surface_points=64 --copies-per-turn 3",
        "labels/symmetry/*.json labels/grasp_label/*.npz labels/models/000/*.ply",
        "labels/affordance",
        0.5,
    ),
    Attack(
        "pack root --out out --split all",
        f"root/affordance/*.h5 root/models/*/*.ply {SCENE}",
        share=3.0,
    ),
    Attack("export-coco root --out out --split all", SCENE, share=3.0),
    Attack(
        f"finetune-detector root --out out/d.safetensors --split all {TRAINING}", SCENE, share=0.3
    ),
    Attack(
        "finetune-detector root --out out/d.safetensors --split all --init weights/detector"
        f".safetensors {TRAINING}",
        "weights/detector.safetensors",
        share=0.3,
    ),
    Attack(
        f"train packed --out out/n.safetensors --set network.num_points=64 {TRAINING}",
        "packed/*.h5",
        share=0.5,
    ),
    *(
        Attack(
            f"train-baseline {name} labelled --out out/n.safetensors {PEER_TRAINING}",
            f"{labels} labelled/scenes/**/* labelled/models/*/*",
            share=0.5,
        )
        for name, labels in PEERS.items()
    ),
    Attack(
        f"train-baseline gg-cnn labelled --out stopped/gg-cnn.safetensors {PEER_TRAINING} --resume",
        "stopped/gg-cnn.checkpoint.safetensors",
        "stopped",
        0.5,
    ),
    *(
        Attack(
            f"infer table --out out.h5 --method {name} --weights weights/{name}.safetensors "
            "--device cpu",
            f"weights/{name}.safetensors",
            "out.h5",
            0.5,
        )
        for name in PEERS
    ),
    Attack(
        "infer frames/flat --out out.h5 --method planar --regions geometric --gripper g.toml "
        "--config infer.toml --device cpu",
        "g.toml infer.toml frames/flat/*",
        "out.h5",
    ),
    Attack(
        "infer table --out out.h5 --method planar --masks masks --workspace workspace.png "
        "--device cpu --top 1",
        "masks/* workspace.png table/*.json",
        "out.h5",
    ),
    *(
        Attack(
            f"infer table --out out.h5 --{name} weights/{name}.safetensors --device cpu",
            f"weights/{name}.safetensors",
            "out.h5",
        )
        for name in WEIGHTS
    ),
    Attack(
        "simulate grasps.h5 --dataset root --out out.json --friction 0.5",
        "grasps.h5 root/models/000/*",
        "out.json",
    ),
    Attack(
        "evaluate grasps.h5 --dataset root --out out.json", f"grasps.h5 {SCENE}", "out.json", 0.7
    ),
    Attack(
        "evaluate dump --dataset root --protocol graspnet --out out.json",
        "dump/scene_0100/**/*.npy",
        "out.json",
        0.3,
    ),
    Attack(
        "compare report.json other.json --resamples 10 --out out.json",
        "report.json report.frames/*.json",
        "out.json",
        4.0,
    ),
    Attack(
        "synthesize out --models mesh/box.obj --split train --scenes-per-split 1 --views 1 "
        "--grasp-points 0 --size 64x48",
        "mesh/box.obj",
    ),
)


def build(folder: Path, run: Run, *, small: bool) -> None:
    """Write all inputs into `folder`; `run` runs a command line there.

    If `small`, without inputs that other commands write.
    """
    for name, (_title, write) in LAYOUTS.items():
        (folder / "frames" / name).mkdir(parents=True)
        write(folder / "frames" / name)
    _more_frames(folder / "frames")
    _meshes(folder / "mesh")
    root = toy_root.write_root(folder / "root")
    results = [toy_root.true_result(root, name) for name in toy_root.frame_names()]
    toy_root.write_grasps(folder / "grasps.h5", results)
    np.save(folder / "rows.npy", toy_dump.dumped_rows(0, 0)[:5])
    write_services(folder)
    (folder / "g.toml").write_bytes((PIPELINES / "grippers/rg2.toml").read_bytes())
    (folder / "infer.toml").write_text(as_toml(default_settings("infer"), "infer"))
    if not small:
        _whole(folder, run)


def _whole(folder: Path, run: Run) -> None:
    (folder / "edits.json").write_text(json.dumps(EDITS))
    _symmetry_inputs(folder)
    _table(folder)
    toy_root.write_root(folder / "held")
    toy_dump.write_dump(folder / "dump")
    dataset_root.write_root(folder / "labels", num_frames=1, num_points=1)
    labelled = toy_root.write_root(folder / "labelled")
    toy_grasp_labels.write_rects(labelled)
    toy_grasp_labels.write_labels(labelled)
    (folder / "weights").mkdir()
    for name in WEIGHTS:
        found = PIPELINES / f"weights/{name.replace('-', '_')}.safetensors"
        (folder / f"weights/{name}.safetensors").write_bytes(found.read_bytes())
    # Loops are compiled once, which takes longer than an attack may.
    run(folder, "infer table --out warm.h5 --device cpu")
    for file in folder.glob("warm.*"):
        file.unlink()
    for name in PEERS:
        run(
            folder,
            f"train-baseline {name} labelled --out weights/{name}.safetensors {PEER_TRAINING}",
        )
    # A training whose weights are gone continues from its checkpoint.
    (folder / "stopped").mkdir()
    (folder / "weights/gg-cnn.checkpoint.safetensors").rename(
        folder / "stopped/gg-cnn.checkpoint.safetensors"
    )
    run(folder, "annotate-symmetry labels")
    run(folder, "pack root --out packed --split all --set num_points=64")
    run(folder, "evaluate grasps.h5 --dataset root --out report.json")
    shutil.copytree(folder / "report.frames", folder / "other.frames")
    shutil.copy(folder / "report.json", folder / "other.json")


def _more_frames(folder: Path) -> None:
    yaml = folder / "yaml"
    yaml.mkdir()
    cv2.imwrite(str(yaml / "a_color.png"), color(0))
    cv2.imwrite(str(yaml / "a_depth.png"), depth(0))
    (yaml / "camera_info.yaml").write_text(ROS_CAMERA)
    others = folder / "others"
    others.mkdir()
    cv2.imwrite(str(others / "a_color.jpg"), color(0))
    cv2.imwrite(str(others / "a_depth.tiff"), depth(0))
    bop = {"cam_K": K.ravel().tolist(), "depth_scale": 1.0}
    (others / "a_camera.json").write_text(json.dumps(bop))
    pickles = folder / "pickles"
    pickles.mkdir()
    content = {"depth": depth(0) / 1000.0, "K": K, "rgb": color(0)}
    np.save(pickles / "a.npy", content, allow_pickle=True)  # type: ignore[arg-type]


def _table(folder: Path) -> None:
    index = write_frame(folder / "table", "t", [Box((0.06, 0.09, 0.1))])
    (folder / "masks").mkdir()
    cv2.imwrite(str(folder / "masks/t_label.png"), (index + 1).astype(np.uint8))
    cv2.imwrite(str(folder / "workspace.png"), np.full(index.shape, 255, np.uint8))


def _meshes(folder: Path) -> None:
    folder.mkdir()
    box = trimesh.creation.box((0.06, 0.04, 0.1))
    for kind in ("ply", "obj", "stl", "off", "glb"):
        box.export(folder / f"box.{kind}")
    text = (folder / "box.obj").read_text()
    (folder / "textured.obj").write_text(f"mtllib m.mtl\nusemtl a\n{text}")
    (folder / "m.mtl").write_text("newmtl a\nmap_Kd nowhere.png\n")


def _symmetry_inputs(folder: Path) -> None:
    box = trimesh.creation.box((0.06, 0.04, 0.1))
    mesh = Mesh(np.asarray(box.vertices), np.asarray(box.faces))
    turns = [np.diag([1.0, -1, -1, 1]).ravel().tolist(), np.diag([-1.0, -1, 1, 1]).ravel().tolist()]
    entry = bop_models_info.entry_of(mesh, []) | {"name": "box", "symmetries_discrete": turns}
    entry["symmetries_continuous"] = [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]
    (folder / "bop.json").write_text(json.dumps({"1": entry}))
    root = GraspNetRoot(folder / "regions_root")
    write_mesh(root.model_path(0), mesh)
    (root.root / "regions").mkdir()
    (root.root / "regions/000.json").write_text(json.dumps(REGIONS))
