"""The table of controllers, against the model's."""

import itertools

from robots.agent.safety.controllers import TRANSITIONS, Change, Controller, after
from tests.support.agents.controller_table import EXPECTED

ROWS = [
    (before, event, into)
    for before, changes in TRANSITIONS.items()
    for event, into in changes.items()
]


def test_table_of_the_kernel_is_that_of_the_model():
    assert {(one.value, event.value): into.value for one, event, into in ROWS} == EXPECTED


def test_every_other_event_leaves_the_controller_unchanged():
    for before, event in itertools.product(Controller, Change):
        if (before.value, event.value) not in EXPECTED:
            assert after(before, event) is before


def test_driver_and_navigation_begin_only_at_rest():
    """A driver or the RCA gets a robot at rest; a driver may interrupt the agent's navigation."""
    given = {
        (before, into) for before, _, into in ROWS if into in {Controller.DRIVER, Controller.RCA}
    }
    assert given == {
        (Controller.NONE, Controller.DRIVER),
        (Controller.NONE, Controller.RCA),
        (Controller.NAVIGATION, Controller.DRIVER),
    }
