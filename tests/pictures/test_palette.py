"""One colour language for pictures, pages and recordings."""

import re

import numpy as np

from pipelines.pictures import palette
from pipelines.pictures.grasp_page.page import HERE


def test_scripts_of_pages_have_the_colours_of_pictures():
    script = (HERE / "content.js").read_text(encoding="utf-8")
    found = {
        name: re.findall(r"#[0-9a-f]{6}", content)
        for name, content in re.findall(r"^const (\w+) = (.*);", script, re.MULTILINE)
    }
    assert found["LOW_TO_HIGH"] == list(palette.SCORE_COLORS)
    assert found["PLANES"] == list(palette.PLANE_COLORS)
    assert found["AXIS"] == [palette.AXIS_COLOR]
    assert found["CONTACT"] == [palette.CONTACT_COLOR]


def test_the_colour_of_a_score_goes_from_grey_to_green():
    colors = palette.score_colors([0.0, 1.0, np.nan])
    assert colors.tolist() == [list(palette.rgb(c)) for c in ("#8a929c", "#3cff5a", "#8a929c")]
    saturation = np.ptp(palette.score_colors(np.linspace(0, 1, 9)).astype(int), axis=1)
    assert (np.diff(saturation) > 0).all()
