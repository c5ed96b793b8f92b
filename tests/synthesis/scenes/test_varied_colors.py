"""Varied textures, lamps and cameras: colours in range, the same for a seed, hardly two alike."""

import numpy as np

from pipelines.synthesis.scenes.lamplight import PLAIN_LOOK, drawn_lamps, drawn_look, photographed
from pipelines.synthesis.scenes.varied_textures import any_color, varied_texture

POINTS = np.random.default_rng(0).uniform(-0.1, 0.1, (500, 3))
PICTURE = np.random.default_rng(1).uniform(0.2, 0.8, (40, 60, 3))


def painted(seed, *, printed=False):
    return varied_texture(np.random.default_rng(seed), printed=printed)(POINTS)


def test_textures_give_every_point_a_colour_that_depends_on_the_seed_alone():
    for seed in range(60):
        colors = painted(seed, printed=seed % 2 == 0)
        assert colors.shape == POINTS.shape
        assert colors.min() >= 0.0
        assert colors.max() <= 1.0
        np.testing.assert_array_equal(colors, painted(seed, printed=seed % 2 == 0))


def test_textures_are_plain_patterned_dark_light_grey_and_saturated():
    colors = [painted(seed) for seed in range(120)]
    spread = np.array([each.std(axis=0).max() for each in colors])
    level = np.array([each.mean() for each in colors])
    tint = np.array([np.ptp(each.mean(axis=0)) for each in colors])
    assert (spread < 1e-6).any()
    assert (spread > 0.2).any()
    assert level.min() < 0.15
    assert level.max() > 0.7
    assert tint.min() < 0.01
    assert tint.max() > 0.4


def test_any_colour_is_within_range():
    drawn = np.array([any_color(np.random.default_rng(seed)) for seed in range(200)])
    assert drawn.min() > 0.0
    assert drawn.max() <= 1.0


def test_lamps_shine_from_above_and_are_one_to_four():
    lamps = [drawn_lamps(np.random.default_rng(seed)) for seed in range(40)]
    assert {len(each) for each in lamps} == {1, 2, 3, 4}
    assert all(lamp.direction[2] > 0.0 for each in lamps for lamp in each)


def test_a_varied_camera_tints_darkens_blurs_and_compresses_and_a_plain_one_does_not():
    plain = photographed(PICTURE, PLAIN_LOOK, np.random.default_rng(0)).astype(float)
    expected = 255.0 * PICTURE ** (1 / 1.5)
    assert np.abs(plain - expected).mean() < 3.0
    looks = [drawn_look(np.random.default_rng(seed)) for seed in range(40)]
    taken = [photographed(PICTURE, look, np.random.default_rng(0)).astype(float) for look in looks]
    assert {look.quality is None for look in looks} == {True, False}
    assert {look.blur > 0 for look in looks} == {True, False}
    assert min(each.mean() for each in taken) < plain.mean() - 20
    assert max(each.mean() for each in taken) > plain.mean() + 20
