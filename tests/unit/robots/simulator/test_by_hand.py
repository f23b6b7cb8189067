"""Whether people can do with their own hands what a study asks of them: on the course, and at the
station, which has no help there.
"""

import pytest

from tests.support.agents.by_hand import Person

CHECKPOINTS = 4


@pytest.mark.parametrize("start", ["1.8,5.5,1.0", "2.4,5.6,-2.5", "2.2,5.3,3.0", "2.8,5.5,0.2"])
@pytest.mark.parametrize(
    ("late", "blur", "looks"),
    [(0.15, (0.01, 0.01), 0.1), (0.4, (0.04, 0.05), 0.3)],
    ids=["deft", "clumsy"],
)
def test_docking_by_keys_has_no_contact(start, late, blur, looks):
    person = Person(seed=5, start=start, late=late, blur=blur, looks=looks)
    seconds = person.drive(passed=CHECKPOINTS, within=180.0)
    assert seconds is not None, f"stands at {person.sim.pose}"
    assert person.sim.contacts == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "closed", [(), ("lounge-door",), ("lab-door",)], ids=["open", "lounge-door", "lab-door"]
)
def test_papers_course_is_driven_with_keys_with_any_door_closed(closed):
    person = Person(seed=2, closed=closed)
    seconds = person.drive(passed=0, within=300.0)
    assert seconds is not None, f"stands at {person.sim.pose} after {person.cue}"
    assert seconds < 180.0
    assert person.node.driver.closed == set(closed)
    assert person.sim.contacts <= (3 if closed else 0)
