"""Memory and disk space of this machine, and of a container on it."""

import pytest

from pipelines.geometry.meshes import ray_search
from pipelines.health import machine
from pipelines.health.checks import Status


def test_free_memory_is_limited_by_the_system_and_the_container(tmp_path):
    info, group = tmp_path / "meminfo", tmp_path / "group"
    info.write_text("MemTotal: 9000 kB\nMemAvailable: 4000 kB\n")
    assert machine.free_memory(info, group) == 4000 * 1024
    group.mkdir()
    (group / "memory.current").write_text("1000\n")
    (group / "memory.stat").write_text("anon 300\ninactive_anon 5\ninactive_file 600\n")
    (group / "memory.max").write_text("max\n")
    assert machine.free_memory(info, group) == 4000 * 1024
    (group / "memory.max").write_text("3000\n")
    assert machine.free_memory(info, group) == 2600
    assert machine.free_memory(tmp_path / "none", tmp_path / "nothing") is None


def test_too_little_space_gives_a_warning(tmp_path):
    assert machine.memory_check(1.0).status is Status.OK
    assert machine.memory_check(1e18).status is Status.WARN
    assert machine.disk_check(tmp_path, 1.0).status is Status.OK
    assert machine.disk_check(tmp_path, 1e18).status is Status.WARN


def test_cores_are_counted(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    check = machine.cores_check()
    assert int(check.text.split()[0]) >= 1
    assert "OMP_NUM_THREADS=3" in check.text


@pytest.mark.parametrize(("there", "words"), [(True, "by Embree"), (False, "without embreex")])
def test_the_library_that_casts_rays_is_named(monkeypatch, there, words):
    monkeypatch.setattr(ray_search, "has_embree", lambda: there)
    assert words in machine.rays_check().text
