"""The choice of benches that `python -m benchmarks` runs; none is run here."""

import pytest

from benchmarks import __main__ as program
from benchmarks.timing import Measurement


@pytest.fixture(autouse=True)
def two_benches(monkeypatch):
    class Bench:
        def __init__(self, name):
            self.name = name

        def measure(self):
            return [Measurement(self.name, 1.0, "s")]

    monkeypatch.setattr(program, "BENCHES", {name: Bench(name) for name in ("one", "two")})


def printed(arguments, capsys):
    program.main(arguments)
    rows = capsys.readouterr().out.splitlines()[2:]
    return [row.split("|")[1].strip() for row in rows]


def test_every_bench_is_run_unless_some_are_named(capsys):
    assert printed([], capsys) == ["one", "two"]
    assert printed(["two"], capsys) == ["two"]


def test_an_unknown_bench_is_refused_with_the_known_names(capsys):
    with pytest.raises(SystemExit) as stop:
        program.main(["three"])
    assert stop.value.code == 2
    assert "three; there are one, two" in capsys.readouterr().err
