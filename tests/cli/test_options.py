"""How options of the command line become those of a batch."""

import joblib
import pytest
from typer.testing import CliRunner

from symgrasp_cli.app import app
from symgrasp_cli.options import batch_options


@pytest.fixture(autouse=True)
def four_cores(monkeypatch):
    monkeypatch.setattr(joblib, "cpu_count", lambda: 4)


@pytest.mark.parametrize(
    ("backend", "workers", "used"), [("loky", 4, 4), ("loky", 100, 4), ("dask", 100, 100)]
)
def test_processes_of_this_machine_are_no_more_than_its_cores(caplog, backend, workers, used):
    options = batch_options(workers, backend, overwrite=False, dry_run=False)
    assert options.workers == used
    said = [f"--workers {workers} is more than this machine's 4 cores: 4 work at a time"]
    assert [record.getMessage() for record in caplog.records] == said * (used < workers)


def test_a_seed_that_no_generator_takes_is_wrong_usage(tmp_path):
    command = ["infer", str(tmp_path), "--out", str(tmp_path / "g.h5"), "--seed", str(2**64)]
    assert CliRunner().invoke(app, command).exit_code == 2
