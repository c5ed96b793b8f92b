"""The batch runner: skipping, collecting, reporting."""

import dataclasses

import h5py
import pytest

from pipelines.errors import SymgraspError, WriteError
from pipelines.runtime import batch
from pipelines.runtime.batch import BatchOptions, StageReport, WorkItem, run_batch
from pipelines.storage.files import write_json
from pipelines.storage.provenance import make_stamp

QUIET = BatchOptions(progress=False)


def items(folder, names, setting=1):
    stamp = make_stamp("toy", {"setting": setting})
    return [WorkItem(name, folder / f"{name}.json", stamp) for name in names]


def step(item):
    if item.name == "bad":
        raise SymgraspError("bad is bad; good would be right")
    write_json(item.target, {"provenance": item.stamp.as_json()})
    return "noted" if item.name == "b" else None


@pytest.mark.parametrize("workers", [1, 2])
def test_one_bad_item_fails_alone(tmp_path, workers):
    options = BatchOptions(workers=workers, progress=False)
    report = run_batch("toy", items(tmp_path, ["a", "bad", "b"]), step, options)
    assert report.done == ["a", "b"]
    assert report.failed == {"bad": "bad is bad; good would be right"}
    assert report.notes == {"b": "noted"}
    assert report.exit_code == 1


def test_an_error_about_a_name_that_is_not_utf8_can_be_stored(tmp_path):
    def refuse(_item):
        raise SymgraspError("caf\udce9.png: this PNG is cut off")

    report = run_batch("toy", items(tmp_path, ["a"]), refuse, QUIET)
    assert report.failed == {"a": "caf%E9.png: this PNG is cut off"}


@pytest.mark.parametrize(("names", "started"), [(["a", "b"], [2]), (["a"], [])])
def test_no_more_workers_than_items_are_started(tmp_path, monkeypatch, names, started):
    asked, workers_of = [], batch.workers_of
    monkeypatch.setattr(
        batch,
        "workers_of",
        lambda backend, count: asked.append(count) or workers_of(backend, count),
    )
    options = BatchOptions(workers=100, progress=False)
    assert run_batch("toy", items(tmp_path, names), step, options).done == names
    assert asked == started


def test_a_second_run_skips_what_is_finished(tmp_path):
    run_batch("toy", items(tmp_path, ["a"]), step, QUIET)
    report = run_batch("toy", items(tmp_path, ["a", "b"]), step, QUIET)
    assert (report.done, report.skipped, report.exit_code) == (["b"], ["a"], 0)


def test_an_item_that_has_lost_one_of_its_files_is_done_again(tmp_path):
    (item,) = items(tmp_path, ["a"])
    item = dataclasses.replace(item, files=(tmp_path / "picture",))

    def draw(each):
        each.files[0].touch()
        return step(each)

    assert run_batch("toy", [item], draw, QUIET).done == ["a"]
    assert run_batch("toy", [item], draw, QUIET).skipped == ["a"]
    item.files[0].unlink()
    assert run_batch("toy", [item], draw, QUIET).done == ["a"]
    assert item.files[0].exists()


def test_an_output_of_other_settings_is_refused_and_not_reused(tmp_path):
    run_batch("toy", items(tmp_path, ["a"]), step, QUIET)
    report = run_batch("toy", items(tmp_path, ["a"], setting=2), step, QUIET)
    assert "other settings" in report.failed["a"]
    forced = BatchOptions(overwrite=True, progress=False)
    assert run_batch("toy", items(tmp_path, ["a"], setting=2), step, forced).done == ["a"]


def test_a_dry_run_writes_nothing(tmp_path):
    report = run_batch("toy", items(tmp_path, ["a"]), step, BatchOptions(dry_run=True))
    assert "would write" in report.notes["a"]
    assert list(tmp_path.iterdir()) == []


def test_an_unexpected_error_fails_its_item_alone_and_is_reported(tmp_path, caplog):
    def broken(item):
        if item.name == "a":
            return [].index("deep")
        return step(item)

    with caplog.at_level("INFO"):
        report = run_batch("toy", items(tmp_path, ["a", "b"]), broken, QUIET)
    assert report.done == ["b"]
    assert "unforeseen ValueError" in report.failed["a"]
    assert "Traceback" in caplog.text


def test_a_fault_of_the_installation_ends_the_batch(tmp_path):
    def broken(item):
        raise ImportError("no such module")

    with pytest.raises(ImportError):
        run_batch("toy", items(tmp_path, ["a"]), broken, QUIET)


@pytest.mark.parametrize("stamp", ["[1, 2]", "3", "[" * 3000, b"\xff", 7, "{", h5py.Empty("f4")])
def test_an_output_whose_stamp_is_no_json_object_is_refused(tmp_path, stamp):
    (item,) = items(tmp_path, ["a"])
    item = dataclasses.replace(item, target=tmp_path / "a.h5")
    with h5py.File(item.target, "w") as file:
        file.attrs["provenance"] = stamp
    report = run_batch("toy", [item], step, QUIET)
    assert "was made with other settings" in report.failed["a"]


def test_a_result_that_cannot_be_written_ends_the_stage():
    report = StageReport("toy")
    with report.attempting("a"):
        raise SymgraspError("a is bad; good would be right")
    with pytest.raises(WriteError), report.attempting("b"):
        raise WriteError("b", "no space")
    assert list(report.failed) == ["a"]


def test_damaged_and_stale_parts_are_dropped_and_finished_ones_stay(tmp_path, caplog):
    parts = items(tmp_path, ["a", "b", "c"])
    run_batch("toy", parts, step, QUIET)
    parts[0].target.write_text("{")
    batch.drop_stale([*parts[:2], *items(tmp_path, ["c"], setting=2)], QUIET)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.json"]
    assert (
        f"removed 2 parts of an earlier run from {tmp_path}: damaged, or made with" in caplog.text
    )


def test_parts_of_former_items_are_dropped(tmp_path):
    run_batch("toy", items(tmp_path, ["a", "former"]), step, QUIET)
    batch.drop_stale(items(tmp_path, ["a"]), QUIET, tmp_path.glob("*.json"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.json"]


def test_parts_to_overwrite_are_dropped_without_a_warning(tmp_path, caplog):
    run_batch("toy", items(tmp_path, ["a"]), step, QUIET)
    overwriting = dataclasses.replace(QUIET, overwrite=True)
    batch.drop_stale(items(tmp_path, ["a"], setting=2), overwriting)
    assert not list(tmp_path.iterdir())
    assert not caplog.text


def test_only_damaged_files_of_a_cache_are_dropped(tmp_path):
    run_batch("toy", items(tmp_path, ["a", "b"]), step, QUIET)
    (tmp_path / "a.json").write_text("{")
    batch.drop_damaged(items(tmp_path, ["a", "b"], setting=2), QUIET)
    assert [path.name for path in tmp_path.iterdir()] == ["b.json"]
