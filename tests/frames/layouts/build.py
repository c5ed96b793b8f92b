"""Small frames in every layout, in the form that the layouts' tools write."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import h5py
import numpy as np
import scipy.io

WIDTH, HEIGHT, COUNT = 48, 36, 2
K = np.array([[60.0, 0.0, 23.5], [0.0, 61.0, 17.5], [0.0, 0.0, 1.0]])
FOUR = (60.0, 61.0, 23.5, 17.5)
LZF_RUN = 32


def color(index: int) -> np.ndarray:
    return np.random.default_rng(index).integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)


def depth(index: int) -> np.ndarray:
    """Depth in millimetres; two pixels are missing."""
    values = np.random.default_rng(9 + index).integers(500, 900, (HEIGHT, WIDTH)).astype(np.uint16)
    values[0, :2] = 0
    return values


def image(path: Path, stored: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), stored[:, :, ::-1] if stored.ndim == 3 else stored)


def pair(color_path: Path, depth_path: Path, index: int, units: int = 1000) -> None:
    image(color_path, color(index))
    image(depth_path, (depth(index).astype(np.uint32) * units // 1000).astype(np.uint16))


def sisters(folder: Path, width: int = 6, color_folder: str = "rgb") -> None:
    for i in range(COUNT):
        name = f"{i:0{width}d}.png"
        pair(folder / color_folder / name, folder / "depth" / name, i)


def graspnet_scene(folder: Path) -> None:
    sisters(folder, 4)
    np.save(folder / "camK.npy", K)


def graspnet_scene_meta(folder: Path) -> None:
    sisters(folder, 4)
    (folder / "meta").mkdir()
    for i in range(COUNT):
        mat(folder / f"meta/{i:04d}.mat", 1000.0)


def mat(path: Path, factor: float) -> None:
    scipy.io.savemat(path, {"intrinsic_matrix": K, "factor_depth": np.array([[factor]])})


def graspnet_demo(folder: Path) -> None:
    pair(folder / "color.png", folder / "depth.png", 0, 2000)
    mat(folder / "meta.mat", 2000.0)


def ycb_video(folder: Path) -> None:
    for i in range(COUNT):
        pair(folder / f"{i:06d}-color.png", folder / f"{i:06d}-depth.png", i, 10000)
        mat(folder / f"{i:06d}-meta.mat", 10000.0)


def bop_scene(folder: Path) -> None:
    sisters(folder)
    camera = {"cam_K": K.ravel().tolist(), "depth_scale": 1.0}
    write(folder / "scene_camera.json", {str(i): camera for i in range(COUNT)})


def sixd_scene(folder: Path) -> None:
    """Write a scene in BOP's first form, SIXD, as of LINEMOD."""
    sisters(folder, 4)
    rows = (f"{i}:\n  cam_K: {K.ravel().tolist()}\n  depth_scale: 1.0\n" for i in range(COUNT))
    write(folder / "info.yml", "".join(rows))
    write(folder / "gt.yml", "0:\n- cam_t_m2c: [1, 2, 3]\n  obj_id: 1\n")


def bop_sensor(folder: Path) -> None:
    """Write one sensor of BOP's industrial data sets, and another one without depth."""
    for i in range(COUNT):
        name = f"{i:06d}.png"
        pair(folder / "rgb_photoneo" / name, folder / "depth_photoneo" / name, i)
        image(folder / "rgb_cam1" / name, color(i))
    camera = {"cam_K": K.ravel().tolist(), "depth_scale": 1.0}
    for sensor in ("photoneo", "cam1"):
        write(folder / f"scene_camera_{sensor}.json", {str(i): camera for i in range(COUNT)})


def write(path: Path, content: object) -> None:
    path.write_text(content if isinstance(content, str) else json.dumps(content))


def bop_image(folder: Path) -> None:
    pair(folder / "rgb.png", folder / "depth.png", 0, 10000)
    write(folder / "camera.json", {"cam_K": K.ravel().tolist(), "depth_scale": 0.1})


def megapose(folder: Path) -> None:
    pair(folder / "image_rgb.png", folder / "image_depth.png", 0)
    write(folder / "camera_data.json", {"K": K.tolist(), "resolution": [HEIGHT, WIDTH]})


def recorder(folder: Path) -> None:
    sisters(folder, color_folder="color")
    camera = {"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": K.T.ravel().tolist()}
    write(folder / "camera_intrinsic.json", camera)


def foundation_pose(folder: Path) -> None:
    sisters(folder)
    np.savetxt(folder / "cam_K.txt", K)


def scannet(folder: Path) -> None:
    sisters(folder, 1, "color")
    (folder / "intrinsic").mkdir()
    full = np.eye(4)
    full[:3, :3] = K
    np.savetxt(folder / "intrinsic/intrinsic_depth.txt", full)


def princeton(folder: Path) -> None:
    for i in range(COUNT):
        stem = f"frame-{i:06d}"
        pair(folder / f"{stem}.color.png", folder / f"{stem}.depth.png", i)
    np.savetxt(folder / "camera-intrinsics.txt", K)


def gqcnn(folder: Path) -> None:
    for i in range(COUNT):
        image(folder / f"color_{i}.png", color(i))
        np.save(folder / f"depth_{i}.npy", depth(i)[:, :, None].astype(np.float32) / 1000)
    names = {"_fx": 60.0, "_fy": 61.0, "_cx": 23.5, "_cy": 17.5, "_width": WIDTH, "_height": HEIGHT}
    write(folder / "phoxi.intr", names)


def tum(folder: Path) -> None:
    lines: dict[str, list[str]] = {"rgb": ["# colour"], "depth": ["# depth"]}
    for i in range(COUNT):
        time = 1305031102.175304 + i / 30
        names = f"rgb/{time:.6f}.png", f"depth/{time + 0.01:.6f}.png"
        pair(folder / names[0], folder / names[1], i, 5000)
        lines["rgb"].append(f"{time:.6f} {names[0]}")
        lines["depth"].append(f"{time + 0.01:.6f} {names[1]}")
    for kind, text in lines.items():
        write(folder / f"{kind}.txt", "\n".join(text))


def nerfstudio(folder: Path) -> None:
    frames = []
    for i in range(COUNT):
        names = {"file_path": f"./images/{i}.png", "depth_file_path": f"depths/{i}.png"}
        pair(folder / names["file_path"], folder / names["depth_file_path"], i)
        frames.append(names | {"transform_matrix": np.eye(4).tolist()})
    camera = {"camera_model": "OPENCV", "w": WIDTH, "h": HEIGHT}
    camera |= dict(zip(("fl_x", "fl_y", "cx", "cy"), FOUR, strict=True))
    write(folder / "transforms.json", camera | {"frames": frames})


def replica(folder: Path) -> None:
    for i in range(COUNT):
        names = (f"room0/results/{image}{i:06d}.png" for image in ("frame", "depth"))
        pair(*(folder / name for name in names), i, 5000)
    numbers = dict(zip(("fx", "fy", "cx", "cy"), FOUR, strict=True))
    camera = {"w": WIDTH, "h": HEIGHT, **numbers, "scale": 5000.0}
    write(folder / "cam_params.json", {"camera": camera})


def arkit_scenes(folder: Path, color_folder: str = "lowres_wide") -> None:
    for i in range(COUNT):
        name = f"41069021_{305.371 + i / 60:.3f}"
        depth_folder = "highres_depth" if color_folder == "wide" else "lowres_depth"
        pair(folder / f"{color_folder}/{name}.png", folder / f"{depth_folder}/{name}.png", i)
        (folder / f"{color_folder}_intrinsics").mkdir(exist_ok=True)
        line = " ".join(map(str, (WIDTH, HEIGHT, *FOUR)))
        write(folder / f"{color_folder}_intrinsics/{name}.pincam", line)


def contact_graspnet(folder: Path) -> None:
    for i in range(COUNT):
        metres = depth(i).astype(np.float32) / 1000
        np.savez(folder / f"{i}.npz", depth=metres, K=K, rgb=color(i)[:, :, ::-1])


def six_dof_graspnet(folder: Path) -> None:
    for i in range(COUNT):
        metres = depth(i).astype(np.float32) / 1000
        np.savez(folder / f"{i}.npz", depth=metres, intrinsics_matrix=K, image=color(i))


def blenderproc(folder: Path) -> None:
    for i in range(COUNT):
        metres = depth(i).astype(np.float32) / 1000
        metres[metres == 0] = 1e10  # the sky
        with h5py.File(folder / f"{i}.hdf5", "w") as file:
            for name, array in (("colors", color(i)), ("depth", metres)):
                file.create_dataset(name, data=array, compression="gzip")
            file["blender_proc_version"] = np.bytes_("2.7.0")
    write(folder / "camera.json", {"K": K.tolist()})


def cloud(index: int) -> np.ndarray:
    """The frame as points (H, W) of x, y, z and packed colour."""
    z = depth(index).astype(np.float32) / 1000
    z[z == 0] = np.nan
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")]
    points = np.zeros((HEIGHT, WIDTH), np.dtype(fields))
    points["x"], points["y"], points["z"] = (u - 23.5) * z / 60, (v - 17.5) * z / 61, z
    r, g, b = np.moveaxis(color(index).astype(np.uint32), 2, 0)
    points["rgb"] = (r << 16) | (g << 8) | b
    return points


def pcd_head(form: str) -> bytes:
    return (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb\n"
        f"SIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH {WIDTH}\nHEIGHT {HEIGHT}\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {WIDTH * HEIGHT}\nDATA {form}\n"
    ).encode()


def pcd(folder: Path) -> None:
    points = cloud(0)
    (folder / "0.pcd").write_bytes(pcd_head("binary") + points.tobytes())
    flat = b"".join(points[name].tobytes() for name in points.dtype.names or ())
    packed = packed_literally(flat)
    sizes = np.array([len(packed), len(flat)], "<u4").tobytes()
    (folder / "1.pcd").write_bytes(pcd_head("binary_compressed") + sizes + packed)
    rows = [" ".join(str(value) for value in point) for point in points.ravel()]
    (folder / "2.pcd").write_bytes(pcd_head("ascii") + "\n".join(rows).encode())


def packed_literally(data: bytes) -> bytes:
    """Return LZF data of literal bytes only."""
    runs = [data[at : at + LZF_RUN] for at in range(0, len(data), LZF_RUN)]
    return b"".join(bytes([len(run) - 1]) + run for run in runs)


def flat(folder: Path) -> None:
    for i in range(COUNT):
        pair(folder / f"{i}_color.png", folder / f"{i}_depth.png", i)
        write(folder / f"{i}_camera.json", dict(zip(("fx", "fy", "cx", "cy"), FOUR, strict=True)))


def folders(folder: Path) -> None:
    sisters(folder)
    write(folder / "intrinsics.txt", "60 61 23.5 17.5")


# The layout's name, and the function that writes it.
LAYOUTS: dict[str, tuple[str, Callable[[Path], None]]] = {
    "graspnet_scene": ("GraspNet scene", graspnet_scene),
    "graspnet_scene_meta": ("GraspNet scene", graspnet_scene_meta),
    "graspnet_demo": ("GraspNet demo folder", graspnet_demo),
    "ycb_video": ("YCB-Video", ycb_video),
    "bop_scene": ("BOP scene", bop_scene),
    "sixd_scene": ("BOP scene", sixd_scene),
    "bop_sensor": ("BOP scene", bop_sensor),
    "bop_image": ("BOP single image", bop_image),
    "megapose": ("BOP single image", megapose),
    "recorder": ("Open3D / RealSense recorder", recorder),
    "foundation_pose": ("FoundationPose", foundation_pose),
    "scannet": ("ScanNet", scannet),
    "princeton": ("7-Scenes / Princeton", princeton),
    "arkit_scenes": ("ARKitScenes", arkit_scenes),
    "replica": ("Replica", replica),
    "gqcnn": ("gqcnn", gqcnn),
    "tum": ("TUM RGB-D", tum),
    "nerfstudio": ("nerfstudio", nerfstudio),
    "contact_graspnet": ("Contact-GraspNet / 6-DOF GraspNet arrays", contact_graspnet),
    "six_dof_graspnet": ("Contact-GraspNet / 6-DOF GraspNet arrays", six_dof_graspnet),
    "blenderproc": ("BlenderProc", blenderproc),
    "pcd": ("organised point cloud", pcd),
    "flat": ("flat pairs", flat),
    "folders": ("colour and depth folders", folders),
}
