"""The table of controllers, against the model's."""

import itertools

from robots.agent.safety.controllers import TRANSITIONS, Change, Controller, after
from tests.support.agents.controller_table import EXPECTED


def test_table_of_the_kernel_is_that_of_the_model():
    found = {
        (before.value, event.value): into.value
        for before, changes in TRANSITIONS.items()
        for event, into in changes.items()
    }
    assert found == EXPECTED


def test_every_other_event_leaves_the_controller_unchanged():
    for before, event in itertools.product(Controller, Change):
        if (before.value, event.value) not in EXPECTED:
            assert after(before, event) is before


def test_driver_and_navigation_begin_only_at_rest():
    """Only a robot at rest is given to a driver or to the RCA, but for one's own navigation."""
    given = {
        (before, into)
        for before, changes in TRANSITIONS.items()
        for into in changes.values()
        if into in {Controller.DRIVER, Controller.RCA}
    }
    assert given == {
        (Controller.NONE, Controller.DRIVER),
        (Controller.NONE, Controller.RCA),
        (Controller.NAVIGATION, Controller.DRIVER),
    }
