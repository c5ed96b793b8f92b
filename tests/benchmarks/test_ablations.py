"""The ablation driver: its steps, its restart, and the table; nothing is trained here."""

import json
from pathlib import Path

import pytest

from benchmarks.ablation_steps import BATCH, Ablations, Budget, Step, epochs
from benchmarks.ablation_table import (
    ABLATIONS,
    COLUMNS,
    FULL,
    IN_CAMERA,
    METRICS,
    NEITHER,
    PLAIN,
    ablation_page,
    rows_named,
    summary,
)
from benchmarks.ablations import main, make_table, parsed, perform, run_symgrasp
from pipelines.configs.stages import STAGE_SETTINGS, EvaluateSettings
from pipelines.errors import SymgraspError
from pipelines.evaluation.reports.reports import read_table
from tests.docs.test_formats_document import block, keys_of

MAKEFILE = Path(__file__).resolve().parents[2] / "Makefile"
BASED = [row.key for row in ABLATIONS if row.base is not None]
SEEDS = (0, 1)
REGIONS = {"refined": 1200, "unrefined": 1200, "uncut": 600}


def report(quality):
    figures = {name: quality for name in METRICS if " " not in name}
    figures["symmetry_ap"] = {"reflection": 0.5, "rotation": 0.6, "sphere": None}
    return {"rows": {"ours": dict.fromkeys(COLUMNS, figures)}}


def comparison(value):
    difference = {"value": value, "low": value - 0.02, "high": value + 0.01}
    figure = {"grasp_quality": {"differences": [difference]}}
    return {"figures": dict.fromkeys(COLUMNS, figure)}


def compared(*values):
    """Return comparisons of every row, one for each seed."""
    return {key: [comparison(value) for value in values] for key in BASED}


class Machine:
    """Writes the output file of each command without its work; stops after `lasting` commands."""

    def __init__(self, lasting=1000):
        self.commands, self.lasting = [], lasting

    def __call__(self, command):
        if len(self.commands) == self.lasting:
            raise SymgraspError("stopped")
        self.commands.append(list(command))
        if "--out" not in command:
            Path(command[1]).mkdir(parents=True, exist_ok=True)
            return
        out = Path(option(command, "--out"))
        out.parent.mkdir(parents=True, exist_ok=True)
        if command[0] == "evaluate":
            out.write_text(json.dumps(report(0.5 if out.parent.name == FULL else 0.4)))
        if command[0] == "compare":
            out.write_text(json.dumps(comparison(-0.1)))
        out.touch()


def work_in(folder, **budget):
    def count(packed, _seed):
        return REGIONS[packed.name]

    return Ablations(Path("benchmark"), folder, Budget(**budget), count)


def option(command, name):
    return command[command.index(name) + 1]


def done(folder, seeds=(0,), machine=None, **budget):
    machine = machine or Machine()
    make_table(work_in(folder, **budget), seeds, machine)
    return machine.commands


def test_every_row_is_trained_inferred_and_evaluated_once(tmp_path):
    names = [command[0] for command in done(tmp_path)]
    assert names.count("infer") == names.count("evaluate") == len(ABLATIONS)
    assert names.count("train") == len([row for row in ABLATIONS if row.network is None])
    assert names.count("finetune-detector") == 2
    assert names.count("compare") == len(ABLATIONS) - 1


def test_seeds_are_of_networks_and_share_the_detectors(tmp_path):
    names = [command[0] for command in done(tmp_path, seeds=(0, 1, 2))]
    assert names.count("finetune-detector") == 2
    assert names.count("infer") == 3 * len(ABLATIONS)


def test_rows_that_follow_the_paper_are_compared_with_each_other(tmp_path):
    made = [command for command in done(tmp_path) if command[0] == "compare"]
    bases = {Path(out).parent.name: Path(base).parent.name for _, base, _, _, out in made}
    assert bases["plain-no-pift"] == bases["plain-no-siamese"] == PLAIN
    assert bases[f"plain-{NEITHER}"] == "plain-no-pift"
    others = {key for key in BASED if not key.startswith("plain-")} - {NEITHER}
    assert bases[NEITHER] == "no-pift"
    assert {bases[key] for key in others} == {FULL}


def test_rows_differ_from_the_full_method_only_in_the_part_they_leave_out(tmp_path):
    trained = {}
    for command in done(tmp_path):
        if command[0] == "train":
            key = Path(option(command, "--out")).stem.removeprefix("network_")
            trained[key] = [each for each in command if str(tmp_path) not in each]
            trained[key].append(Path(command[1]).name)
    full = trained[FULL]
    assert sorted(set(trained["no-pift"]) - set(full)) == ["--no-pift"]
    assert sorted(set(trained["no-siamese"]) - set(full)) == ["--no-siamese"]
    assert sorted(set(trained[NEITHER]) - set(full)) == ["--no-pift", "--no-siamese"]
    assert sorted(set(trained[IN_CAMERA]) - set(full)) == ["--no-canonical-frame"]
    assert set(trained["no-refinement"]) - set(full) == {"unrefined"}
    assert "uncut" in trained["no-regions"]


def test_all_networks_take_the_same_steps_with_the_same_decay(tmp_path):
    for command in done(tmp_path, steps=1000):
        if command[0] == "train":
            steps_per_epoch = REGIONS[Path(command[1]).name] // BATCH
            count = int(option(command, "--epochs"))
            assert count * steps_per_epoch == 1000
            assert float(option(command, "--decay-epochs")) == pytest.approx(count / 20)


def test_rows_without_their_own_network_take_the_network_they_name(tmp_path):
    inferred = [command for command in done(tmp_path) if command[0] == "infer"]
    taken = {Path(option(c, "--out")).parent.name: option(c, "--network") for c in inferred}
    assert Path(taken["no-grounding"]).stem == Path(taken[PLAIN]).stem == f"network_{FULL}"
    assert Path(taken["plain-no-pift"]).stem == "network_no-pift"


def test_a_base_stands_before_the_rows_compared_with_it():
    keys = [row.key for row in ABLATIONS]
    assert all(keys.index(row.base) < keys.index(row.key) for row in ABLATIONS if row.base)
    assert all(keys.index(row.network) < keys.index(row.key) for row in ABLATIONS if row.network)


def test_only_the_row_without_regions_has_another_detector(tmp_path):
    for command in done(tmp_path):
        if command[0] == "infer":
            uncut = Path(option(command, "--out")).parent.name == "no-regions"
            expected = "detector_uncut" if uncut else "detector_refined"
            assert Path(option(command, "--detector")).stem == expected


def test_an_interrupted_run_goes_on_with_the_step_it_stopped_in(tmp_path):
    whole = done(tmp_path / "whole")
    first = Machine(lasting=9)
    with pytest.raises(SymgraspError, match="stopped"):
        done(tmp_path / "cut", machine=first)
    rest = done(tmp_path / "cut")
    assert len(first.commands) == 9
    assert [c[0] for c in first.commands + rest] == [c[0] for c in whole]
    assert done(tmp_path / "cut") == []


def test_later_seeds_keep_the_outputs_of_the_first_one(tmp_path):
    done(tmp_path)
    assert all("seed0" not in " ".join(c) for c in done(tmp_path, seeds=(0, 1)))


def test_a_failed_command_is_named_and_leaves_no_record(tmp_path):
    step = Step("wrong", ("infer",))
    with pytest.raises(SymgraspError, match="`symgrasp infer` ended with 2"):
        perform(iter([step]), tmp_path, run_symgrasp)
    assert list(tmp_path.iterdir()) == []


def test_steps_with_other_defaults_are_run_again_which_refuses_or_skips_them(tmp_path, monkeypatch):
    done(tmp_path)
    monkeypatch.setitem(STAGE_SETTINGS, "evaluate", lambda: EvaluateSettings(min_region_share=0.4))
    assert {command[0] for command in done(tmp_path)} == {"evaluate"}
    assert done(tmp_path) == []


def test_deleted_outputs_are_made_again(tmp_path):
    done(tmp_path)
    work_in(tmp_path).report(ABLATIONS[1], 0).unlink()
    assert [command[0] for command in done(tmp_path)] == ["evaluate"]


def test_finished_rows_stay_in_the_table_of_a_run_with_fewer_rows(tmp_path):
    done(tmp_path)
    fewer = work_in(tmp_path)
    fewer.chosen = rows_named(["no-pift"])
    make_table(fewer, (0,), Machine())
    assert set(json.loads((tmp_path / "ablations.json").read_text())["rows"]) == {
        row.key for row in ABLATIONS
    }
    work_in(tmp_path).report(ABLATIONS[0], 0).unlink()  # the base that others are compared with
    assert not any(fewer.is_finished(row, (0,)) for row in ABLATIONS if row.base == FULL)


@pytest.mark.parametrize("seeds", ["a", "", "0, ", "-1", "1.5"])
def test_wrong_seeds_are_reported_in_one_sentence(tmp_path, capsys, seeds):
    assert main([str(tmp_path), f"--seeds={seeds}"]) == 1
    assert capsys.readouterr().err.startswith("error: --seeds is")


def test_a_missing_benchmark_is_reported_before_anything_is_made(tmp_path, capsys):
    assert main([str(tmp_path / "none"), "--out", str(tmp_path / "out")]) == 1
    assert "none/scenes does not exist" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_difference_over_one_scene_has_no_interval():
    reports = {row.key: [report(0.5)] for row in ABLATIONS}
    alone = comparison(-0.1)
    for split in COLUMNS:
        difference = alone["figures"][split]["grasp_quality"]["differences"][0]
        difference["low"] = difference["high"] = None
    text = ablation_page(summary(reports, {key: [alone] for key in BASED}, [0]))
    assert "| -0.100 |" in text
    assert "None" not in text


def test_another_budget_is_refused_and_names_the_folder(tmp_path):
    done(tmp_path)
    with pytest.raises(SymgraspError, match="same budget"):
        done(tmp_path, scenes=9)


def test_a_training_is_never_shorter_than_an_epoch():
    assert epochs(5, 100)[1] == 1
    assert epochs(5, 0)[1] == 5


def test_the_table_holds_the_papers_figures_and_our_mean_and_spread():
    reports = {row.key: [report(0.5), report(0.6)] for row in ABLATIONS}
    found = summary(reports, compared(-0.1, -0.2), SEEDS)
    novel = found["rows"]["no-pift"]["novel"]
    assert novel["grasp_quality"]["mean"] == pytest.approx(0.55)
    assert novel["grasp_quality"]["spread"] == pytest.approx(0.1 / 2**0.5)
    assert novel["symmetry_ap sphere"]["mean"] is None
    assert novel["difference"]["mean"] == pytest.approx(-0.15)
    text = ablation_page(found)
    row = "| no PIFT | 0.337 | 0.092 | " + " | ".join(["0.550 ± 0.071"] * 4) + " |"
    assert row in text
    assert "| no PIFT | -0.045 | -0.205 | -0.150 ± 0.071 |" in text
    paper = "| as the paper, no PIFT (to: as the paper decodes and ranks) | -0.045 | -0.205 |"
    assert paper in text
    assert "| no fit to the seen surface | - | - |" in text


def test_one_seed_has_no_spread_but_the_interval_over_scenes():
    reports = {row.key: [report(0.5)] for row in ABLATIONS}
    text = ablation_page(summary(reports, compared(-0.1), [0]))
    assert "| full method | 0.382 | 0.297 | 0.500 |" in text
    assert "| -0.100 (-0.120 to -0.090) |" in text


def test_a_split_that_the_benchmark_lacks_is_shown_as_a_dash():
    some, difference = report(0.5), comparison(-0.1)
    some["rows"]["ours"] = {"all": some["rows"]["ours"]["all"]}
    difference["figures"] = {"all": difference["figures"]["all"]}
    reports = {row.key: [some] for row in ABLATIONS}
    text = ablation_page(summary(reports, {key: [difference] for key in BASED}, [0]))
    assert "| full method | 0.382 | 0.297 | - | - | - | 0.500 |" in text
    assert "| no PIFT | -0.045 | -0.205 | - | - | - | -0.100 (-0.120 to -0.090) |" in text


def test_each_row_has_its_own_difference():
    reports = {row.key: [report(0.5)] for row in ABLATIONS}
    each = {key: [comparison(-0.1 * place)] for place, key in enumerate(BASED)}
    rows = summary(reports, each, [0])["rows"]
    found = [rows[key]["all"]["difference"]["mean"] for key in BASED]
    assert found == [-0.1 * place for place in range(len(BASED))]
    assert "difference" not in rows[FULL]["all"]


def test_a_chosen_row_brings_the_rows_it_needs():
    keys = [row.key for row in rows_named(["plain-no-pift"])]
    assert keys == [FULL, PLAIN, "no-pift", "plain-no-pift"]


def test_every_chosen_row_brings_its_base_and_its_network():
    for row in ABLATIONS:
        chosen = rows_named([row.key])
        keys = {each.key for each in chosen}
        assert all({each.base, each.network} - {None} <= keys for each in chosen)


def test_an_unknown_row_is_refused():
    with pytest.raises(SymgraspError, match="no-pifd"):
        rows_named(["no-pifd"])


def test_rows_that_were_left_out_can_follow(tmp_path):
    machine, some = Machine(), rows_named(["no-pift"])
    work = work_in(tmp_path)
    work.chosen = some
    make_table(work, [0], machine)
    content = json.loads((tmp_path / "ablations.json").read_text(encoding="utf-8"))
    assert list(content["rows"]) == [row.key for row in some]
    rest = done(tmp_path)
    whole = done(tmp_path / "whole")
    assert len(machine.commands) + len(rest) == len(whole)


def test_the_table_grows_by_the_rows_that_are_finished(tmp_path):
    with pytest.raises(SymgraspError, match="stopped"):
        done(tmp_path, machine=Machine(lasting=20))
    content = json.loads((tmp_path / "ablations.json").read_text(encoding="utf-8"))
    whole = [row.key for row in ABLATIONS]
    assert list(content["rows"]) == whole[: len(content["rows"])]
    assert 0 < len(content["rows"]) < len(whole)
    done(tmp_path)
    content = json.loads((tmp_path / "ablations.json").read_text(encoding="utf-8"))
    assert list(content["rows"]) == whole


def test_both_files_are_written_with_a_stamp(tmp_path):
    text = make_table(work_in(tmp_path), [0], Machine())
    assert (tmp_path / "ablations.md").read_text(encoding="utf-8") == text
    table = read_table(tmp_path / "table.json")
    assert table["title"].startswith("Table IV")
    assert [row[0] for row in table["rows"]] == [row.name for row in ABLATIONS]
    content = json.loads((tmp_path / "ablations.json").read_text(encoding="utf-8"))
    assert content["provenance"]["stage"] == "ablations"
    assert len(content["provenance"]["inputs"]) == len(ABLATIONS) + len(BASED)
    lines = block("keys", "ablations")
    assert set(content) == keys_of(lines)
    assert set(content["rows"]["no-pift"]) == keys_of(lines, depth=1)


def test_the_makefile_names_the_default_budget():
    options, text = parsed(["root"]), MAKEFILE.read_text(encoding="utf-8")
    assert f"\nSTEPS := {options.steps}\n" in text
    assert f"\nDETECTOR_STEPS := {options.detector_steps}\n" in text
    assert f"\nSCENES := {options.scenes}\n" in text
    assert f"\nOBJECTS := {options.objects}\n" in text
