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


def main() -> None:
    print("ready", flush=True)
    for line in sys.stdin:
        start, key = line.split()
        participant = Participant.objects.select_related("study", "user").get(pk=key)
        while time.time() < float(start):
            pass  # a sleep would wake up late, without a race
        condition = grants.draw(participant, timezone.now())
        print(condition.key if condition is not None else "full", flush=True)


if __name__ == "__main__":
    main()
