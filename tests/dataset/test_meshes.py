"""Reading and writing meshes."""

import logging
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal

from pipelines.dataset import meshes
from pipelines.dataset.mesh_folders import find_meshes
from pipelines.dataset.meshes import (
    clean_mesh,
    read_mesh,
    read_own_mesh,
    refuse_too_small,
    size_warning,
    smallness_warning,
    write_mesh,
)
from pipelines.errors import FormatError, SymgraspError, UnknownNameError, ValueRangeError
from pipelines.geometry.meshes.mesh import Mesh


def box(size: float = 0.1) -> Mesh:
    shape = trimesh.creation.box(extents=(size, 2 * size, 3 * size))
    return Mesh(np.asarray(shape.vertices, np.float32).astype(float), np.asarray(shape.faces))


@pytest.mark.parametrize("suffix", [".ply", ".obj"])
def test_a_written_mesh_is_read_again(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"box{suffix}"
    write_mesh(path, box())
    again = read_mesh(path)
    assert_allclose(again.vertices[again.faces], box().vertices[box().faces], atol=1e-7)


@pytest.mark.parametrize("suffix", [".ply", ".obj"])
def test_the_same_mesh_gives_the_same_bytes(tmp_path: Path, suffix: str) -> None:
    first, second = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    write_mesh(first, box())
    write_mesh(second, box())
    assert first.read_bytes() == second.read_bytes()


def test_other_programs_read_the_same_mesh_from_the_ply(tmp_path: Path) -> None:
    write_mesh(tmp_path / "box.ply", box())
    stranger = trimesh.load_mesh(tmp_path / "box.ply", process=False)
    assert_allclose(stranger.vertices, box().vertices, atol=1e-8)
    assert_array_equal(stranger.faces, box().faces)


@pytest.mark.parametrize("suffix", [".stl", ".off", ".glb", ".ply", ".obj"])
def test_foreign_meshes_become_watertight_with_triangles_in_order(
    tmp_path: Path, suffix: str
) -> None:
    shape = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
    shape.export(tmp_path / f"ball{suffix}")
    mesh = read_mesh(tmp_path / f"ball{suffix}")
    assert mesh.is_watertight
    assert_allclose(mesh.vertices[mesh.faces], shape.triangles, atol=1e-6)


def test_triangles_of_an_obj_with_several_materials_keep_their_order(tmp_path: Path) -> None:
    write_mesh(tmp_path / "plain.obj", box())
    lines, faces = (tmp_path / "plain.obj").read_text().splitlines(), iter("ABA" * 4)
    mixed = [f"usemtl {next(faces)}\n{line}" if line[0] == "f" else line for line in lines]
    (tmp_path / "mixed.obj").write_text("mtllib x.mtl\n" + "\n".join(mixed))
    plain, again = read_mesh(tmp_path / "plain.obj"), read_mesh(tmp_path / "mixed.obj")
    assert_array_equal(again.triangles, plain.triangles)


def test_a_mesh_without_triangles_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.ply"
    trimesh.PointCloud(np.random.default_rng(0).random((5, 3))).export(path)
    with pytest.raises(FormatError, match="triangle"):
        read_mesh(path)


def test_vertices_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "nan.obj"
    path.write_text("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(FormatError, match="NaN"):
        read_mesh(path)


@pytest.mark.parametrize("header", ["OFF\n8 12 0\n", "OFF 8 12 0  # counts\n\n# a comment\n"])
def test_an_off_file_that_is_cut_off_after_any_line_is_refused(tmp_path: Path, header: str) -> None:
    path, cube = tmp_path / "cube.off", trimesh.creation.box()
    lines = [" ".join(map(str, corner)) for corner in cube.vertices]
    lines += [f"3 {a} {b} {c}" for a, b, c in cube.faces]
    path.write_text(header + "\n".join(lines) + "\n")
    assert len(read_mesh(path).faces) == 12
    for kept in range(9, len(lines)):  # the first is without triangles
        path.write_text(header + "\n".join(lines[:kept]) + "\n")
        with pytest.raises(FormatError, match=rf"has {kept} of 20 announced vertices and faces"):
            read_mesh(path)


@pytest.mark.parametrize("text", ["", "8 12 0\n0 0 0\n", "off\n8 12 0\n0 0 0\n"])
def test_a_file_without_the_header_of_off_is_not_called_cut_off(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.off").write_text(text)
    with pytest.raises(FormatError, match=r"not readable as \.off"):
        read_mesh(tmp_path / "a.off")


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".glb", ".off"])
def test_a_damaged_mesh_is_reported_in_one_sentence(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"bad{suffix}"
    path.write_bytes(b"\x00nonsense that is no mesh")
    with pytest.raises(FormatError, match=r"bad\."):
        read_mesh(path)


def test_a_missing_mesh_and_a_foreign_suffix_are_reported_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(SymgraspError, match="does not exist"):
        read_mesh(tmp_path / "none.ply")
    with pytest.raises(UnknownNameError, match=r"\.docx"):
        read_mesh(tmp_path / "part.docx")


def test_a_mesh_in_millimetres_gives_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_mesh(tmp_path / "large.ply", box(100.0))
    with caplog.at_level(logging.WARNING):
        read_mesh(tmp_path / "large.ply")
    assert "millimetres" in caplog.text
    assert "374.2 m" in caplog.text


def test_an_own_mesh_in_millimetres_is_refused_unless_its_unit_is_stated(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_mesh(tmp_path / "large.ply", box(100.0))
    right = r"large\.ply: .* 374\.2 m .*--mesh-scale 0\.001 .* 0\.3742 m, 0\.01 .* 3\.742 m, and 1 "
    with pytest.raises(SymgraspError, match=right):
        read_own_mesh(tmp_path / "large.ply", None)
    with caplog.at_level(logging.WARNING):
        assert read_own_mesh(tmp_path / "large.ply", 1.0).diagonal > 300.0
        mesh = read_own_mesh(tmp_path / "large.ply", 0.001)
    assert not caplog.text
    assert size_warning(mesh, tmp_path) is None
    assert_allclose(np.ptp(mesh.vertices, axis=0), (0.1, 0.2, 0.3), rtol=1e-6)


def test_a_mesh_too_small_to_be_held_is_refused_with_its_size(tmp_path: Path) -> None:
    path = tmp_path / "small.ply"
    assert smallness_warning(box(0.002), path) is None  # 7.5 mm
    refuse_too_small(box(0.002), path)
    with pytest.raises(SymgraspError, match=r"small\.ply: .* 3\.74 mm .*5 mm .*--mesh-scale"):
        refuse_too_small(box(0.001), path)


def test_degenerate_and_duplicate_triangles_are_dropped_and_reported() -> None:
    good = box()
    point, line, middle = [0, 0, 1], [0, 1, len(good.vertices)], good.vertices[[0, 1]].mean(axis=0)
    turned = good.faces[3][[1, 2, 0]]  # the same triangle, another corner first
    faces = np.concatenate([[point], good.faces, [line], [turned], [turned[::-1]]])
    mesh, kept, note = clean_mesh(Mesh(np.concatenate([good.vertices, [middle]]), faces))
    assert_array_equal(mesh.faces, good.faces)
    assert_array_equal(kept, np.arange(len(good.faces)) + 1)
    assert note == "dropped 2 degenerate triangles and 2 duplicate triangles"
    assert clean_mesh(good)[2] == ""


def test_a_mesh_of_degenerate_triangles_alone_is_refused() -> None:
    with pytest.raises(ValueRangeError, match="without area"):
        clean_mesh(Mesh(np.eye(3), np.array([[0, 0, 1]])))


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl", ".off"])
def test_an_empty_file_is_reported_in_one_sentence(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"empty{suffix}"
    path.write_bytes(b"")
    with pytest.raises(FormatError, match=r"empty\."):
        read_mesh(path)


def test_meshes_of_a_folder_are_listed_in_order(tmp_path: Path) -> None:
    for name in ("b.ply", "a.ply"):
        write_mesh(tmp_path / name, box())
    (tmp_path / "notes.txt").write_text("none")
    assert [path.name for path in find_meshes(tmp_path)] == ["a.ply", "b.ply"]


def test_real_meshes_are_read(shared: Path) -> None:
    for path in find_meshes(shared / "meshes")[::15]:
        mesh = read_mesh(path)
        assert 0.01 < mesh.diagonal < 2.0


def test_comments_in_another_encoding_do_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "box.obj"
    write_mesh(path, box())
    path.write_bytes("# Würfel, Größe in Metern\n".encode("latin-1") + path.read_bytes())
    assert len(read_mesh(path).faces) == 12


def test_meshes_that_are_passed_over_are_counted_and_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for name in ("a.ply", "b.STEP", "c.3mf", "texture.png", "below/d.obj", "empty/readme.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    with caplog.at_level(logging.WARNING):
        assert [path.name for path in find_meshes(tmp_path)] == ["a.ply"]
    assert "2 files of formats that are not read: b.STEP, c.3mf" in caplog.text
    assert "gmsh NAME.step -2 -o NAME.stl" in caplog.text
    assert "meshes of subfolders are not read: below; give each by name" in caplog.text
    assert "texture" not in caplog.text
    (tmp_path / "a.ply").unlink()
    with pytest.raises(SymgraspError, match=r"holds no meshes; 2 files.*b\.STEP"):
        find_meshes(tmp_path)


def test_a_mesh_of_another_format_is_refused_with_the_way_to_convert_it(tmp_path: Path) -> None:
    (tmp_path / "part.stp").write_bytes(b"")
    with pytest.raises(FormatError, match=r"part\.stp.*gmsh"):
        read_mesh(tmp_path / "part.stp")


def test_the_meshes_of_the_shared_folder_that_are_passed_over_are_named(
    caplog: pytest.LogCaptureFixture, shared: Path
) -> None:
    folder = shared / "cases/mesh_folder_silent"
    with caplog.at_level(logging.WARNING):
        assert [path.name for path in find_meshes(folder)] == ["nested.glb"]
    assert (
        "2 files of formats that are not read: P_XPM_0331_01.3mf, featuretype.STEP" in caplog.text
    )


def test_textures_that_a_mesh_names_are_not_looked_for(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    text = box.export(file_type="obj")
    (tmp_path / "m.mtl").write_text("newmtl a\nmap_Kd nowhere.png\n")
    (tmp_path / "x.obj").write_text(f"mtllib m.mtl\nusemtl a\n{text}")
    assert len(read_mesh(tmp_path / "x.obj").faces) == 12
    assert not caplog.records


def test_a_scene_that_shows_a_mesh_without_end_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = trimesh.Scene()
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    for number in range(20):
        scene.add_geometry(box, node_name=str(number), geom_name="box")
    (tmp_path / "x.glb").write_bytes(scene.export(file_type="glb"))
    assert len(read_mesh(tmp_path / "x.glb").faces) == 240
    monkeypatch.setattr(meshes, "MAX_TRIANGLES", 100)
    with pytest.raises(FormatError, match="contains 240 triangles; at most 100"):
        read_mesh(tmp_path / "x.glb")


def test_a_vertex_without_its_three_numbers_is_reported_in_one_sentence(tmp_path: Path) -> None:
    rows = ["v 0 0 0", "v 1 0", "v 0 1", "v 1 1", "f 1 2 3"]
    for kept in (rows[1:], rows):
        (tmp_path / "x.obj").write_text("\n".join(kept).replace("v 0 0 0", "v 0 0") + "\n")
        with pytest.raises(FormatError, match=r"x\.obj"):
            read_mesh(tmp_path / "x.obj")
