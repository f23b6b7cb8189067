"""One of several processes that assign participants at the same instant: `python -m
tests.support.sessions.cell_racer`.

Reads a line for each round from its standard input, `<start> <participant>`, waits until `start`
(Unix seconds), assigns, and answers with the cell.
"""

import os
import sys
import time

import django

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "tests.settings")
django.setup()

from django.utils import timezone

from experiments.models import Participant
from experiments.participation import grants
from robots.models import Robot


def main() -> None:
    print("ready", flush=True)
    robot = Robot.objects.select_related("floor_plan").get()
    for line in sys.stdin:
        start, key = line.split()
        participant = Participant.objects.select_related("study", "user").get(pk=key)
        pending = grants.pending_drive(participant.user, robot)
        assert pending is not None
        while time.time() < float(start):
            pass  # a sleep would wake up late, without a race
        condition = grants.draw(participant, pending.cells, timezone.now())
        print(condition.key if condition is not None else "full", flush=True)


if __name__ == "__main__":
    main()
