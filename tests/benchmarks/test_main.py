"""Which benches `python -m benchmarks` runs; none is run here."""

import pytest

from benchmarks import __main__ as program
from benchmarks.timing import Measurement


@pytest.fixture
def told(monkeypatch):
    class Bench:
        def __init__(self, name):
            self.name = name

        def measure(self):
            return [Measurement(self.name, 1.0, "s")]

    monkeypatch.setattr(program, "BENCHES", {name: Bench(name) for name in ("one", "two")})


def names(run, arguments, capsys):
    run(arguments)
    rows = capsys.readouterr().out.splitlines()[2:]
    return [row.split("|")[1].strip() for row in rows]


def test_every_bench_is_run_unless_some_are_named(told, capsys):
    assert names(program.main, [], capsys) == ["one", "two"]
    assert names(program.main, ["two"], capsys) == ["two"]


def test_a_name_of_no_bench_is_refused_with_those_there_are(told, capsys):
    with pytest.raises(SystemExit) as stop:
        program.main(["three"])
    assert stop.value.code == 2
    assert "three; there are one, two" in capsys.readouterr().err
