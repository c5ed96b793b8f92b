"""Progress lines of a running training."""

import logging

from pipelines.learning.progress.display import Display

LOSSES = {"total": 1.5, "part": 0.5}


def test_without_a_terminal_progress_is_printed_as_lines(caplog, capsys):
    with caplog.at_level(logging.INFO), Display(shown=True, bar=False, seconds=0.0) as display:
        display.step("1/3", 5, 10, LOSSES, 90.0)
        display.say("validation after 5 steps")
    assert caplog.messages == [
        "epoch 1/3, step 5/10, total 1.500, part 0.500, 1:30 left",
        "validation after 5 steps",
    ]


def test_a_bar_shows_the_time_left_and_keeps_printed_messages(capsys):
    with Display(shown=True, bar=True, seconds=0.0) as display:
        display.step("1/3", 5, 10, LOSSES, 90.0)
        display._bar.refresh()
        shown = display._bar.get_renderable()
        display.say("validation [1] after 5 steps")
        task = display._bar.tasks[0]
        assert (task.completed, task.total, task.fields["left"]) == (5, 10, "1:30")
        assert shown is not None
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "validation [1] after 5 steps" in printed.err


def test_other_processes_are_silent(caplog, capsys):
    with caplog.at_level(logging.INFO), Display(shown=False, bar=True, seconds=0.0) as display:
        display.step("1/3", 5, 10, LOSSES, 90.0)
        display.say("x")
    assert caplog.messages == []
    assert capsys.readouterr().err == ""
