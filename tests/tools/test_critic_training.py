"""Judges are trained to choose: what a choice loses, whole groups in a step, files put together."""

import numpy as np
import pytest
import torch

from tests import tool_scripts

training = tool_scripts.load("critic_training")


def made_rows(groups=60, size=10, seed=0):
    """Groups of rows whose truth is told by one coordinate of their points."""
    rng = np.random.default_rng(seed)
    count = groups * size
    points = rng.normal(size=(count, 8, 11)).astype(np.float32)
    told = np.clip(0.5 + 0.5 * points[:, :, 0].mean(axis=1), 0, 1)
    evidence = rng.normal(size=(count, 3)).astype(np.float32)
    group = np.repeat(np.arange(groups), size)
    return {
        "points": points,
        "wholes": evidence[:, :0],
        "evidence": evidence,
        "truth": told.astype(np.float32),
        "group": group,
    }


def test_what_a_choice_loses_is_the_best_less_what_it_gives_in_the_mean_over_groups():
    rng = np.random.default_rng(0)
    group = rng.permutation(np.repeat([3, 7, 20], [5, 1, 9]))
    logits, truth = rng.normal(scale=4.0, size=15), rng.random(15)
    losses = []
    for each in (3, 7, 20):
        weight = np.exp(logits[group == each])
        given = np.average(truth[group == each], weights=weight)
        losses.append(truth[group == each].max() - given)
    found = training.choice_loss(*map(torch.from_numpy, (logits, truth, group)))
    assert float(found) == pytest.approx(np.mean(losses), abs=1e-9)


def test_choosing_the_best_loses_nothing_and_large_logits_do_not_overflow():
    truth = torch.tensor([0.2, 0.9, 0.1, 0.6, 0.5])
    group = torch.tensor([0, 0, 0, 1, 1])
    best = torch.tensor([0.0, 500.0, 0.0, 500.0, -500.0], requires_grad=True)
    loss = training.choice_loss(best, truth, group)
    loss.backward()
    assert float(loss.detach()) == pytest.approx(0.0, abs=1e-6)
    assert torch.isfinite(best.grad).all()


def test_a_step_takes_whole_groups_and_a_pass_every_row_once():
    group = np.random.default_rng(0).integers(0, 90, 1000)
    steps = training.batches(group, True, np.random.default_rng(1))
    assert sorted(np.concatenate(steps)) == list(range(1000))
    assert len(steps) > 1
    assert all(len(step) >= training.BATCH for step in steps[:-1])
    of_step = [set(group[step]) for step in steps]
    assert sum(map(len, of_step)) == len(set(group))


def test_without_choices_a_step_takes_any_rows():
    steps = training.batches(np.zeros(1000, int), False, np.random.default_rng(1))
    assert [len(step) for step in steps] == [training.BATCH] * 3
    assert len(set(np.concatenate(steps))) == 3 * training.BATCH


def test_groups_of_several_files_stay_apart_and_unknown_truth_is_left_out(tmp_path):
    parts = [
        {k: v[:4] for k, v in made_rows(1, 4, seed).items() if k != "group"} for seed in (0, 1)
    ]
    parts[1]["truth"][0] = -1.0
    for name in ("a.npz", "b.npz"):
        assert training.write(tmp_path / name, parts) == 8
    rows = training.read([tmp_path / "a.npz", tmp_path / "b.npz"])
    assert rows["group"].tolist() == [0] * 4 + [1] * 3 + [2] * 4 + [3] * 3


def test_a_step_minds_each_candidate_and_the_choice_as_much_as_is_asked():
    rows, chosen = made_rows(), np.arange(100)
    columns = [torch.from_numpy(rows[name][chosen]) for name in ("points", "wholes", "evidence")]
    mean, spread = columns[2].mean(0), columns[2].std(0)
    critic = training.TrainedCritic(11, 0, mean, spread).eval()

    def loss(choice):
        how = training.Training(
            mirrored=(2, 6), points_a_step=8, jitter=0.0, rate=1.0, choice=choice
        )
        torch.manual_seed(0)  # the same mirror images
        return float(training.step_loss(critic, rows, chosen, how).detach())

    torch.manual_seed(0)
    how = training.Training(mirrored=(2, 6), points_a_step=8, jitter=0.0, rate=1.0)
    with torch.no_grad():
        logits = critic(how.varied(columns[0]), *columns[1:])
    truth, group = (torch.from_numpy(rows[name][chosen]) for name in ("truth", "group"))
    loses = float(training.choice_loss(logits, truth, group))
    assert loses > 0.1
    assert loss(2.0) - loss(0.0) == pytest.approx(2.0 * loses, abs=1e-5)


@pytest.mark.parametrize("choice", [0.0, 1.0])
def test_what_was_learned_chooses_well_among_rows_never_seen(choice):
    how = training.Training(
        mirrored=(2, 6), points_a_step=6, jitter=0.01, rate=3e-3, epochs=20, choice=choice
    )
    critic, held = training.trained(made_rows(), how, 0), made_rows(seed=1)
    with torch.no_grad():
        said = critic(*(torch.from_numpy(held[k]) for k in ("points", "wholes", "evidence")))
    truth, said = held["truth"].reshape(-1, 10), said.numpy().reshape(-1, 10)
    chosen = truth[np.arange(len(truth)), said.argmax(axis=1)]
    assert chosen.mean() > 0.5 * (truth.mean() + truth.max(axis=1).mean())
