"""A page is complete: it loads nothing, names are text, and it stays small."""

import re

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from pipelines.configs import ViewConfig
from pipelines.frames.rgbd import Frame
from pipelines.geometry.camera import Intrinsics
from pipelines.grasp_files.grasps_tables import FrameResult
from pipelines.grasp_files.gripper_files import load_gripper
from pipelines.pictures.grasp_page.page import IndexEntry, frame_page, index_page, result_words
from pipelines.pictures.grasp_page.scene import frame_scene
from pipelines.storage.provenance import make_stamp
from tests.evaluation.page_reader import Reader
from tests.pictures.grasp_page.toys import decoded, scene_of, toy_frame, toy_result

STAMP = make_stamp("view", {"note": '"<&>'})
FRAME, INDEX = toy_frame()
RESULT = toy_result(FRAME, INDEX)
SCENE = frame_scene(FRAME, RESULT, load_gripper("rg2"), ViewConfig())
PAGE = frame_page(SCENE, RESULT, STAMP)
ENTRIES = [
    IndexEntry("a/b #1?", "frames/a/b #1?.html", "frames/a/b #1?.jpg", "3 grasps"),
    IndexEntry("<i>x</i>", None, None, "infer failed on it (<b>)", failed=True),
]
INDEX_PAGE = index_page("g.h5: 2 <frames>", ENTRIES, STAMP)


class PageReader(Reader):
    """Collects elements; knows our elements without an end tag."""

    def handle_starttag(self, tag, attrs):
        super().handle_starttag(tag, attrs)
        if tag == "input":
            self.open.pop()


@pytest.mark.parametrize("text", [PAGE, INDEX_PAGE])
def test_nothing_is_loaded_from_a_network(text):
    assert not re.search(r"(?:https?:)?//[a-z0-9-]+\.[a-z]", text, re.IGNORECASE)
    assert "@import" not in text
    assert not re.search(r"url\(|fetch\(|XMLHttpRequest|import\(|importScripts", text)
    policy = [a for tag, a in PageReader(text).found if "http-equiv" in a]
    assert policy[0]["content"].startswith("default-src 'none'")
    assert "http" not in policy[0]["content"]


def test_the_page_of_a_frame_needs_no_other_file():
    loading = [(tag, a) for tag, a in PageReader(PAGE).found if "src" in a or tag == "link"]
    assert loading == []


def test_names_are_text_and_not_elements():
    reader = PageReader(PAGE)
    assert FRAME.name in reader.text
    assert "b" not in [tag for tag, _ in reader.found if tag == "b"]
    assert scene_of(PAGE)["name"] == FRAME.name
    listed = PageReader(INDEX_PAGE)
    assert "<i>x</i>" in listed.text
    assert "(<b>)" in listed.text


def test_links_lead_to_files_whatever_their_names():
    links = [a["href"] for tag, a in PageReader(INDEX_PAGE).found if tag == "a"]
    pictures = [a["src"] for tag, a in PageReader(INDEX_PAGE).found if tag == "img"]
    assert links == ["frames/a/b%20%231%3F.html"]
    assert pictures == ["frames/a/b%20%231%3F.jpg"]
    back = [a["href"] for tag, a in PageReader(PAGE).found if tag == "a"]
    assert back == ["../" * (FRAME.name.count("/") + 1) + "index.html"]


def test_embedded_arrays_equal_the_given_ones():
    found = scene_of(PAGE)
    for name, entry in SCENE["arrays"].items():
        assert_array_equal(decoded(found["arrays"][name]), decoded(entry))
    depth = decoded(found["arrays"]["depth"]) * found["depth_step"]
    assert np.abs(depth - FRAME.depth).max() <= 0.5 * found["depth_step"] * (1 + 1e-6)


def test_the_largest_page_stays_below_eight_megabytes():
    rng = np.random.default_rng(0)
    size = (1200, 1600)
    frame = Frame(
        "a",
        rng.integers(0, 256, (*size, 3), dtype=np.uint8),
        rng.uniform(0.3, 9.0, size).astype(np.float32),
        Intrinsics(1500, 1500, 800, 600, 1600, 1200),
    )
    result = FrameResult("a", "empty", "nothing", frame.intrinsics)
    most = ViewConfig(max_pixels=700_000)  # the limit of the command
    nothing = len(frame_page(frame_scene(frame, result, load_gripper("rg2"), most), result, STAMP))
    a_grasp = (len(PAGE) - len(frame_page(
        frame_scene(FRAME, toy_result(FRAME, INDEX, 0), load_gripper("rg2"), ViewConfig()),
        RESULT, STAMP))) / len(RESULT.grasps)  # fmt: skip
    assert nothing + ViewConfig.max_grasps * a_grasp < 8e6


def test_every_control_that_the_scripts_ask_for_is_there():
    wanted = set(re.findall(r'by\("([\w-]+)"\)', PAGE))
    assert wanted
    ids = {a["id"] for _, a in PageReader(PAGE).found if "id" in a}
    assert wanted <= ids


def test_a_frame_is_described_in_words():
    assert result_words(RESULT) == "5 grasps on 2 of 2 regions"
    assert result_words(toy_result(FRAME, INDEX, 0)) == "empty: nothing stands out"
