"""The page of a report, parsed as a browser would."""

from dataclasses import replace
from pathlib import Path

from pipelines.evaluation.pages.gallery import Gallery, Picture, Tag
from pipelines.evaluation.pages.report_page import report_page
from pipelines.evaluation.reports.figures import report_curves, report_rows
from pipelines.evaluation.runs.records import FrameRecord, RowRecord, ScoredPredictions
from pipelines.evaluation.runs.tallies import ReportTally
from pipelines.metrics.grasp_verdicts import REASONS, Verdict
from tests.evaluation.page_reader import Reader

FORMATS = Path(__file__).resolve().parents[3] / "docs" / "reference" / "formats.md"


def report() -> dict:
    verdicts = [Verdict(i, reason, min_friction=0.3) for i, reason in enumerate(REASONS)]
    planes = {"reflection": ScoredPredictions(2, [0.9, 0.8], {"0.25": [1, 0], "0.134": [1, 0]})}
    row = RowRecord(verdicts, planes)
    record = FrameRecord("f", "seen", 0.1, ScoredPredictions(0), {"ours": row, "planar": row})
    tally = ReportTally.of([record])
    thresholds = ((0.25, 0.134), 0.05)
    return {
        "rows": report_rows(tally, *thresholds),
        "curves": report_curves(tally, *thresholds),
        "seconds_per_frame": 0.1,
        "provenance": {"version": "1", "seed": 0, "inputs": {"grasps": "<x>"}, "config": {}},
    }


def gallery() -> Gallery:
    tags = [
        Tag(f"mug <{i}>", (0.2, 0.3), Verdict(i, reason, 0.5)) for i, reason in enumerate(REASONS)
    ]
    return Gallery([Picture("scene/a", "seen", 0.5, b"jpeg", (64, 48), tags)], [])


def test_the_page_is_well_formed_and_fetches_nothing():
    page = report_page(report(), gallery())
    reader = Reader(page)
    assert "http" not in page
    assert not {"script", "link", "iframe"} & {tag for tag, _ in reader.found}
    sources = [attrs["src"] for tag, attrs in reader.found if tag == "img"]
    assert [source[:23] for source in sources] == ["data:image/jpeg;base64,"]


def test_names_of_frames_objects_splits_and_inputs_are_text_and_not_elements():
    (picture,) = gallery().best
    script = "<script>alert('x')</script>"
    tags = [replace(tag, name=script) for tag in picture.tags]
    named = replace(picture, name=f"{script}1", split=f"{script}2", tags=tags)
    made = report()
    made["provenance"]["inputs"] = {script: "<x>"}
    made["provenance"]["config"] = {"gripper": f'"{script}'}
    reader = Reader(report_page(made, Gallery([named], [named])))
    assert not {"script", "x"} & {tag for tag, _ in reader.found}
    for text in (f"{script}1, {script}2: mean", f"{script}: held, quality", "<x>", f'"{script}'):
        assert text in reader.text


def test_every_object_of_a_picture_has_its_reason_in_words():
    text = Reader(report_page(report(), gallery())).text
    for index, reason in enumerate(REASONS):
        assert f"mug <{index}>: {reason}" in text


def test_the_legend_of_the_pictures_is_that_of_the_documents():
    page, document = (
        " ".join(text.split()).lower().replace("**", "")
        for text in (
            Reader(report_page(report(), gallery())).text,
            FORMATS.read_text(encoding="utf-8"),
        )
    )
    for words in (
        "grippers have the colour of their score: grey for 0, through yellowish green, to green",
        "grippers of grasps that are not worth trying are thin",
        "stronger if the best grasp uses them",
        "score of its best grasp",
    ):
        assert words in page
        assert words in document
    assert "orange" not in page


def test_curves_have_axes_with_labels_and_a_line_a_threshold():
    page = report_page(report(), Gallery())
    reader = Reader(page)
    assert {"friction", "recall", "precision"} <= set(reader.text.replace(",", " ").split())
    lines = [attrs for tag, attrs in reader.found if tag == "polyline"]
    assert len(lines) == 2 + 2  # share held of two methods; reflection at two thresholds
    for line in lines:
        points = [tuple(map(float, pair.split(","))) for pair in line["points"].split()]
        assert all(0 <= x <= 420 and 0 <= y <= 290 for x, y in points)


def test_every_threshold_has_a_line_of_its_own():
    made = report()
    (first, *_) = made["curves"]["symmetry"]["ours"]["reflection"].values()
    keys = ["0.5", "0.4", "0.3", "0.2", "0.1"]
    made["curves"]["symmetry"]["ours"]["reflection"] = dict.fromkeys(keys, first)
    reader = Reader(report_page(made, Gallery()))
    lines = [attrs for tag, attrs in reader.found if tag == "polyline"][2:]
    assert len({line.get("stroke-dasharray") for line in lines}) == len(lines) == len(keys)
    assert all(f"error below {key}" in reader.text for key in keys)


def test_tables_stand_under_their_headings_and_given_ones_last():
    made = report()
    made["tables"] = [{"title": "Cost <of>", "header": ["row", "s"], "rows": [["ours", "0.3"]]}]
    text = Reader(report_page(made, Gallery())).text
    titles = (
        "Table I.",
        "Table III",
        "Symmetry, average precision",
        "Average precision of region masks",
        "Cost <of>",
    )
    headings = ("Grasps", "Success", "Symmetries", "Region masks")
    places = [text.index(title) for title in titles]
    assert places == sorted(places)
    for heading, title in zip(headings, titles, strict=False):
        assert text[: text.index(title)].rstrip().endswith(heading)


def test_a_report_of_nothing_is_a_page_too():
    tally = ReportTally.of([FrameRecord("f", "seen", 0.1, ScoredPredictions(0), {})])
    empty = {
        "rows": report_rows(tally, (0.25,), 0.05),
        "curves": report_curves(tally, (0.25,), 0.05),
    }
    Reader(report_page(empty, Gallery()))
