from robots.agent.safety.controllers import TRANSITIONS, Controller

ALLOWED = """
    none,       driven,           driver
    none,       moves unbidden,   settling
    none,       handed over,      rca
    none,       passed on,        navigation
    driver,     at rest,          none
    driver,     driver changed,   settling
    driver,     moves unbidden,   settling
    settling,   at rest,          none
    navigation, navigation left,  driver
    rca,        passed on,        navigation
    rca,        navigation left,  settling
"""
ROWS = [
    (before, event, into)
    for before, changes in TRANSITIONS.items()
    for event, into in changes.items()
]


def test_controllers_change_only_as_listed():
    listed = {tuple(map(str.strip, row.split(","))) for row in ALLOWED.strip().splitlines()}
    assert {(before.value, event.value, into.value) for before, event, into in ROWS} == listed


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
