"""Every page calls a robot the same: the landing page's cards (robots/cards.py) and the drive page
(templates/sessions/_words.html, static/js/view/hud/status.js).
"""

import datetime
import re

import pytest
from django.conf import settings

from robots.cards import Traffic, card
from tests.support.robots import unsaved_robot

NOW = datetime.datetime(2026, 3, 1, 12, 0, tzinfo=datetime.UTC)
HOME = {"returns_home": True}
CALLED = {
    "ready": {},
    "stopped": {"report": {"safety": {"estop": True}}},
    "fault": {"report": {"safety": {"inhibited": "fault"}}},
    "returning": {**HOME, "turnaround": "returning", "turnaround_reason": "dock"},
    "checked": {**HOME, "turnaround": "returning", "turnaround_reason": "picture"},
    "charging": {**HOME, "turnaround": "charging"},
    "paused": {**HOME, "turnaround": "paused"},
    "held": {"held": "a new carpet"},
}


def words() -> dict[str, str]:
    page = (settings.BASE_DIR / "templates/sessions/_words.html").read_text()
    return dict(re.findall(r'data-word="status\.([a-z_]+)">{% translate "([^"]+)" %}', page))


@pytest.mark.parametrize("word", CALLED)
def test_a_robot_is_called_on_its_page_as_on_its_card(word):
    robot = unsaved_robot(
        name="giraff", title="Giraff", connection="ONLINE", last_seen_at=NOW, **CALLED[word]
    )
    shown = card(robot, Traffic(), barred="", url="", now=NOW)
    assert words()[word] == shown.label


def test_a_robot_that_is_driven_is_called_the_same_too():
    robot = unsaved_robot(name="giraff", title="Giraff", connection="ONLINE", last_seen_at=NOW)
    shown = card(robot, Traffic(in_use=True), barred="", url="", now=NOW)
    assert words()["busy"] == shown.label
    own = card(robot, Traffic(in_use=True, own=True), barred="", url="", now=NOW)
    assert words()["own"] == own.label
