"""Two processes repeatedly request a robot at the same instant, on real databases."""

from collections.abc import Iterator

import pytest

from tests.support.sessions.races import DATABASES, Racers, racing_on

pytestmark = [pytest.mark.long, pytest.mark.nightly]

ROUNDS = [10, pytest.param(10_000, marks=pytest.mark.soak)]
PREPARE = """
from accounts.models import User
from tests.support.robots import create_robots, unsaved_robot
from django.utils import timezone
now = timezone.now() + timezone.timedelta(hours=1)  # online during the whole test
create_robots(
    *(unsaved_robot(name=f"{prefix}-{n}", title="r", connection="ONLINE", last_seen_at=now)
    for n in range(rounds))
)
for name in ("ana", "ben"):
    User.objects.get_or_create(username=name)
print(rounds)
"""
READ = """
from accounts.models import User
from django.utils import timezone
from robots.models import Robot
from sessions.leases.store import take
robot_name, visitor_name, peer = question
robot, visitor = Robot.objects.get(name=robot_name), User.objects.get(username=visitor_name)
"""
TAKE = """
taken = take(robot, visitor, peer, now=timezone.now())
print(json.dumps({"kind": type(taken).__name__, "session": str(taken.session)}))
"""
COUNT = """
from sessions.models import Lease, Session
live = Session.objects.exclude(state="ended").filter(robot__name__startswith=prefix)
leases = Lease.objects.filter(robot__name__startswith=prefix)
print(json.dumps({
    "driving": live.exclude(state="waiting").count(),
    "waiting": live.filter(state="waiting").count(),
    "leases": leases.count(), "epochs": sorted(set(leases.values_list("epoch", flat=True))),
    "held": leases.filter(session__isnull=False).count(),
    "agree": all(lease.session.state == "connecting" for lease in leases.select_related("session")),
}))
"""


@pytest.fixture(scope="module", params=DATABASES)
def racers(request, tmp_path_factory) -> Iterator[Racers]:
    with racing_on(request.param, tmp_path_factory.mktemp("races")) as racers:
        yield racers


def run(racers: Racers, prefix: str, visitors: tuple[str, str], rounds: int):
    """Return the answers of each round, and the counts of sessions and leases afterwards."""
    names = {"prefix": f"{prefix}{rounds}", "rounds": rounds}
    racers.ask(PREPARE, **names)
    answers = [
        racers.race(READ, TAKE, (robot, visitors[0], "left"), (robot, visitors[1], "right"))
        for robot in (f"{names['prefix']}-{n}" for n in range(rounds))
    ]
    return answers, racers.ask(COUNT, **names)


def counts(rounds: int, waiting: int) -> dict:
    """Return the expected sessions and leases: one of each is granted in each round."""
    granted = {"driving": rounds, "leases": rounds, "held": rounds}
    return granted | {"waiting": waiting, "epochs": [1], "agree": True}


@pytest.mark.parametrize("rounds", ROUNDS)
def test_one_of_two_visitors_drives_and_the_other_waits(racers, rounds):
    answered, found = run(racers, "two", ("ana", "ben"), rounds)
    kinds = [sorted(answer["kind"] for answer in answers) for answers in answered]
    assert kinds == [["Queued", "TakeGranted"]] * rounds
    winners = [answers[0]["kind"] == "TakeGranted" for answers in answered]
    assert 0 < sum(winners) < rounds, "one side won every time: they did not race"
    assert found == counts(rounds, waiting=rounds)


@pytest.mark.parametrize("rounds", ROUNDS)
def test_one_of_two_tabs_drives_and_the_other_gets_the_session(racers, rounds):
    answered, found = run(racers, "tab", ("ana", "ana"), rounds)
    for answers in answered:
        assert sorted(answer["kind"] for answer in answers) == ["Refused", "TakeGranted"]
        assert answers[0]["session"] == answers[1]["session"], "two tabs, one session"
    assert found == counts(rounds, waiting=0)
