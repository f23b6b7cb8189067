"""How far a script is, and what deviates from it."""

import pytest

from robots.api import messages as m
from sessions.wizard.script import Script, ScriptProgress, ScriptStage, ScriptStep, action_of


def script(*steps, **fields):
    return Script(language="en", stages=(ScriptStage(key="s", title="S", steps=steps),), **fields)


def step(key, **fields):
    return ScriptStep(key=key, title=key, **fields)


def pressed(progress, *keys, every=1.0):
    found = []
    for number, key in enumerate(keys):
        press = progress.press(key, (number + 1) * every)
        found.append((press.deviation, press.skipped))
    return found


ABCD = [step(key) for key in "abcd"]


def test_steps_in_their_order_deviate_from_nothing():
    assert pressed(ScriptProgress(script(*ABCD), 0.0), *"abcd") == [("", 0)] * 4


def test_a_step_reports_how_many_it_skips_and_those_are_out_of_order_later():
    assert pressed(ScriptProgress(script(*ABCD), 0.0), *"adbcc") == [
        ("", 0),
        ("out_of_order", 2),
        ("out_of_order", 0),
        ("out_of_order", 0),
        ("repeated", 0),
    ]


def test_a_free_script_has_no_order():
    progress = ScriptProgress(script(*ABCD, is_ordered=False), 0.0)
    assert pressed(progress, *"dabd") == [("", 0)] * 4


@pytest.mark.parametrize("ordered", [True, False])
def test_a_step_is_late_when_it_is_begun_too_long_after_the_one_before_or_the_beginning(ordered):
    steps = [step("a", within=2.0), step("b", within=2.0), step("c")]
    progress = ScriptProgress(script(*steps, is_ordered=ordered), 10.0)
    assert progress.press("a", 12.5).deviation == "late"
    assert progress.press("b", 14.4).deviation == ""
    assert progress.press("c", 99.0).deviation == ""


def test_a_step_that_is_only_judged_is_neither_done_nor_the_last():
    progress = ScriptProgress(script(step("a"), step("b", within=2.0)), 0.0)
    for _ in range(2):
        assert progress.judge("a", 5.0).deviation == ""
    assert (progress.done, progress.pressed_at) == ([], None)
    assert progress.judge("b", 1.0).skipped == 1


def test_a_step_that_the_script_does_not_have_is_none():
    progress = ScriptProgress(script(*ABCD), 0.0)
    assert progress.press("x", 1.0) is None
    assert progress.done == []


def test_each_step_requests_one_action_of_the_robot():
    given = {"action_id": "a1", "stamp": 1.0}
    say = action_of(step("a", text="Hello", aloud=False), "en", **given)
    assert say == m.Say(text="Hello", language="en", aloud=False, **given)
    assert action_of(step("a", action="goto", place="desk"), "en", **given) == m.Goto(
        place="desk", **given
    )
    assert action_of(step("a", action="dock"), "en", **given) == m.Dock(**given)
    assert action_of(step("a", action="undock"), "en", **given) == m.Undock(**given)
    assert action_of(step("a", action="tilt", angle=0.2), "en", **given) == m.Tilt(
        angle=0.2, **given
    )
    assert action_of(step("a", turn=1.0), "en", **given) is None
