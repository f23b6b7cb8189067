"""One of several processes that assign participants at the same instant: `python -m
tests.support.cell_racer`.

Reads a line for each round from its standard input, `<start> <participant>`, waits until `start`
(Unix seconds), assigns, and answers with the cell.
"""

import os
import sys
import time

import django

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "tests.settings")
django.setup()

from django.utils import timezone  # noqa: E402

from experiments.models import Participant  # noqa: E402
from experiments.participation import grants  # noqa: E402
from robots.models import Robot  # noqa: E402


def main() -> None:
    print("ready", flush=True)  # noqa: T201 -- its parent reads this
    robot = Robot.objects.select_related("floor_plan").get()
    for line in sys.stdin:
        start, key = line.split()
        participant = Participant.objects.select_related("study", "user").get(pk=key)
        standing = grants.standing_of(participant.user, robot)
        assert standing is not None
        while time.time() < float(start):
            pass  # a sleep wakes up late, and then nobody races
        condition = grants.assign(standing, timezone.now())
        print(condition.key if condition is not None else "full", flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
