"""Training of critics: the loss of a choice, whole groups in a step, calibrated odds."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.special import expit

from pipelines.configs import TrainCriticConfig
from pipelines.errors import ValueRangeError
from pipelines.learning.critics.critic_training import CriticTraining, batch_loss, choice_loss
from pipelines.learning.critics.kinds import CRITIC_KINDS
from pipelines.learning.speed.micro_batches import generator
from tests.learning.critics.rows import made_rows

CONFIG = TrainCriticConfig(batch_size=100, jitter=0.0, dropout=0.0, learning_rate=0.003)
GRASPS, PLANES = CRITIC_KINDS["grasps"], CRITIC_KINDS["planes"]


def training(kind=GRASPS, config=CONFIG, **shape):
    return CriticTraining(kind, made_rows(kind, **shape), made_rows(kind, seed=1), config)


def test_the_loss_of_a_choice_is_the_mean_of_best_minus_expected_truth_over_groups():
    rng = np.random.default_rng(0)
    group = rng.permutation(np.repeat([3, 7, 20], [5, 1, 9]))
    logits, truth = rng.normal(scale=4.0, size=15), rng.random(15)
    losses = []
    for each in (3, 7, 20):
        weight = np.exp(logits[group == each])
        expected = np.average(truth[group == each], weights=weight)
        losses.append(truth[group == each].max() - expected)
    found = choice_loss(*map(torch.from_numpy, (logits, truth, group)))
    assert float(found) == pytest.approx(np.mean(losses), abs=1e-9)


def test_choosing_the_best_loses_nothing_and_large_logits_do_not_overflow():
    truth = torch.tensor([0.2, 0.9, 0.1, 0.6, 0.5])
    group = torch.tensor([0, 0, 0, 1, 1])
    best = torch.tensor([0.0, 500.0, 0.0, 500.0, -500.0], requires_grad=True)
    loss = choice_loss(best, truth, group)
    loss.backward()
    assert float(loss.detach()) == pytest.approx(0.0, abs=1e-6)
    assert torch.isfinite(best.grad).all()


def test_a_step_of_grasps_takes_whole_groups_and_an_epoch_takes_every_candidate_once():
    trainee = training(groups=90, size=7)
    batches = trainee.epoch(0, np.random.default_rng(0))
    taken = [np.concatenate(batch) for batch in batches]
    assert sorted(np.concatenate(taken)) == list(range(630))
    assert all(len(each) >= CONFIG.batch_size for each in taken[:-1])
    groups = [set(trainee.rows.group[each]) for each in taken]
    assert sum(map(len, groups)) == 90


def test_a_single_candidate_is_refused_in_the_singular():
    one = replace(made_rows(PLANES, groups=1, size=1), truth=np.ones(1, np.float32))
    with pytest.raises(ValueRangeError, match=r"^1 candidate to learn from is not both true and"):
        CriticTraining(PLANES, one, made_rows(PLANES), CONFIG)


def test_a_step_of_planes_takes_any_candidates():
    trainee = training(PLANES, groups=25, size=10)
    taken = [np.concatenate(batch) for batch in trainee.epoch(0, np.random.default_rng(0))]
    assert [len(each) for each in taken] == [100, 100]
    assert len(set(np.concatenate(taken))) == 200


def test_a_step_sees_some_points_or_their_mirror_images_with_a_little_noise():
    trainee = training(GRASPS, replace(CONFIG, point_share=0.5, jitter=0.01))
    batch = trainee.load([np.arange(40)], [generator(0)])
    assert batch.points.shape == (40, 4, len(GRASPS.features.point))
    rows, mirrored, other, signs = trainee.rows.points.astype(np.float32), [*GRASPS.mirrored], 3, []
    for own, points in zip(rows, batch.points.numpy(), strict=False):
        for point in points:
            source = own[np.abs(own[:, other] - point[other]).argmin()]
            sign = np.sign(point[mirrored[1]] / source[mirrored[1]])
            image = source.copy()
            image[mirrored] *= sign
            np.testing.assert_allclose(point, image, atol=0.06)
            signs.append(sign)
    assert 0.2 < (np.array(signs) > 0).mean() < 0.8


def test_the_features_of_a_grasp_are_mirrored_with_its_points():
    trainee = training(GRASPS, replace(CONFIG, point_share=1.0, jitter=0.0))
    batch, rows = trainee.load([np.arange(40)], [generator(0)]), trainee.rows[np.arange(40)]
    names, column = GRASPS.features.candidate, GRASPS.mirrored[0]
    total = rows.points[..., column].astype(np.float32).sum(axis=1)
    signs = np.sign(batch.points[..., column].numpy().sum(axis=1) / total)
    assert set(signs) == {-1.0, 1.0}
    for k, name in enumerate(names):
        expected = rows.candidates[:, k] * (signs if name in GRASPS.mirrored_candidates else 1.0)
        np.testing.assert_allclose(batch.candidates[:, k], expected, rtol=1e-6)


def test_the_same_draws_give_the_same_batch():
    trainee = training(GRASPS, replace(CONFIG, jitter=0.1))
    first, second = (trainee.load([np.arange(9)], [generator(0, 3)]).points for _ in range(2))
    assert torch.equal(first, second)


@torch.no_grad()
def test_the_loss_weighs_each_candidate_and_the_choice():
    trainee, draws = training(), torch.Generator
    batch = trainee.load([np.arange(100)], [generator(0)])
    alone = batch_loss(trainee.module, batch, draws(), 0.0, 0.0)
    both = batch_loss(trainee.module, batch, draws(), 0.0, 2.0)
    choice = float(choice_loss(trainee.module(batch), batch.truth, batch.group))
    assert choice > 0.1
    assert float(both["total"] - alone["total"]) == pytest.approx(2.0 * choice, abs=1e-5)


def test_dropped_numbers_are_drawn_from_the_given_generator():
    trainee = training()
    batch = trainee.load([np.arange(100)], [generator(0)])

    def loss(seed):
        drawing = torch.Generator().manual_seed(seed)
        return float(batch_loss(trainee.module, batch, drawing, 0.5, 0.0)["total"].detach())

    assert loss(0) == loss(0) != loss(1)


def test_validation_calibrates_the_module_and_scores_its_choices():
    trainee = training()
    figures = trainee.validate()
    critic, held = trainee.module.as_critic(), trainee.held
    given = held.points.astype(np.float32), held.shared, held.candidates
    odds, logits = critic.probability(*given), critic.fast_logits(*given)
    bias, slope = critic.weights["calibration"]
    np.testing.assert_allclose(odds, expit(bias + slope * logits), rtol=1e-5)
    assert odds.mean() == pytest.approx(held.truth.mean(), abs=1e-3)
    truth, scores = held.truth.reshape(-1, 10), logits.reshape(-1, 10)
    chosen = truth[np.arange(len(truth)), scores.argmax(axis=1)]
    assert figures["chosen"] == pytest.approx(chosen.mean(), abs=1e-6)
    assert figures["best"] == pytest.approx(truth.max(axis=1).mean(), abs=1e-6)


@pytest.mark.parametrize("kind", [GRASPS, PLANES], ids=["grasps", "planes"])
def test_a_trained_critic_chooses_well_among_new_candidates(kind):
    trainee = training(kind)
    before = trainee.validate()
    optimizer = torch.optim.Adam(trainee.module.parameters(), CONFIG.learning_rate)
    for epoch in range(15):
        for step, items in enumerate(trainee.epoch(epoch, generator(0, epoch))):
            batch = trainee.load(items, [generator(0, epoch, step)])
            loss = trainee.loss(trainee.module, batch, torch.Generator())["total"]
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
    after = trainee.validate()
    assert after["loss"] < before["loss"] - 0.005
    assert after["chosen"] > 0.5 * (float(trainee.held.truth.mean()) + after["best"])


def test_candidates_that_are_all_true_are_refused():
    rows = made_rows(PLANES)
    rows.truth[:] = 1.0
    with pytest.raises(ValueRangeError, match="600 candidates to calibrate on"):
        CriticTraining(PLANES, made_rows(PLANES), rows, CONFIG)
