"""One of several processes that ask for the same robot at the same instant: `python -m
tests.support.sessions.lease_racer`.

Reads a line for each round from its standard input, `<start> <robot> <visitor> <peer>`, waits until
`start` (Unix seconds, so that all of them fall on the same instant), asks, and answers with one
line of JSON.
"""

import datetime
import json
import os
import sys
import time

import django

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "tests.settings")
django.setup()

from accounts.models import User
from robots.models import Robot
from sessions.leases.store import take


def main() -> None:
    print("ready", flush=True)
    for line in sys.stdin:
        start, robot_name, visitor_name, peer = line.split()
        robot, visitor = Robot.objects.get(name=robot_name), User.objects.get(username=visitor_name)
        while time.time() < float(start):
            pass  # a sleep would wake up late, without a race
        taken = take(robot, visitor, peer, now=datetime.datetime.now(datetime.UTC))
        answer = {
            "kind": type(taken).__name__,
            "epoch": getattr(taken, "epoch", None),
            "session": str(taken.session),
        }
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
