from robots.agent.safety.controllers import TRANSITIONS, Controller


def test_driver_and_navigation_begin_only_at_rest():
    """A driver or the RCA gets a robot at rest; a driver may interrupt the agent's navigation."""
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
