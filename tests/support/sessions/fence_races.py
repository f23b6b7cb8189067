"""Session managers that race for one shard in a real database, and write under its fence. `python
-m tests.support.sessions.fence_races ROUNDS` races on the database of DATABASE_URL, as threads;
with `--stop SECONDS` as processes, of which nearly always one is stopped, wherever it is: for so
long, unless the others are done before.
"""

import argparse
import contextlib
import dataclasses
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass

import django

if __name__ == "__main__":
    os.environ.setdefault("DJANGO_SETTINGS_MODULE", "tests.settings")
    django.setup()

from django.db import InterfaceError, InternalError, OperationalError, connection, transaction
from django.utils import timezone

from sessions.models import ManagerBeat, Shard
from sessions.shards import rows
from sessions.shards.hashing import shard_of
from sessions.shards.ownership import Fenced, Ownership

ROBOT = "giraff"
SHARD = shard_of(ROBOT)
ABREAST = (
    10  # rounds after which all wait for each other: alone, one after another, none would race
)
WRITTEN = "written"  # a row whose `beats` are the epoch of its last writer


@dataclass
class Races:
    """What the threads of one race did; `wrong` writes were accepted after one of a later owner."""

    accepted: int = 0
    refused: int = 0
    taken: int = 0
    wrong: int = 0
    cut_off: int = 0  # by the server, while the process was stopped


class Racer(threading.Thread):
    def __init__(
        self, number: int, rounds: int, races: Races, lock: threading.Lock, line: threading.Barrier
    ) -> None:
        super().__init__(name=f"racer-{number}")
        self._rng = random.Random(number)
        self._rounds, self._races, self._lock, self._line = rounds, races, lock, line
        self._ownership = Ownership()

    def run(self) -> None:
        with contextlib.ExitStack() as unless_done:
            unless_done.callback(self._line.abort)  # the others do not wait for one that has failed
            with contextlib.closing(connection):
                for number in range(self._rounds):
                    if number % ABREAST == 0:
                        self._line.wait()
                    self._race()
            unless_done.pop_all()

    def _race(self) -> None:
        try:
            if self._rng.random() < 0.2:
                self._take()
            elif self._ownership.epochs:
                self._write()
        except (OperationalError, InterfaceError, InternalError):
            if connection.vendor == "sqlite":
                raise
            connection.close()
            self._count(cut_off=1)

    def _take(self) -> None:
        there = Shard.objects.get(number=SHARD)
        rows.take_over([SHARD], [there.owner], self.name)
        mine = {one.number: one.epoch for one in rows.holdings() if one.owner == self.name}
        self._ownership.become(mine)
        self._count(taken=len(mine))

    def _write(self) -> None:
        epoch = self._ownership.epochs[SHARD]
        try:
            with self._ownership.fenced(), self._ownership.about(ROBOT), transaction.atomic():
                last = ManagerBeat.objects.select_for_update().get(name=WRITTEN).beats
                ManagerBeat.objects.filter(name=WRITTEN).update(beats=epoch)
        except Fenced:
            self._count(refused=1)
        else:
            self._count(accepted=1, wrong=last > epoch)

    def _count(self, **more: int) -> None:
        with self._lock:
            for name, n in more.items():
                setattr(self._races, name, getattr(self._races, name) + n)


def _prepare() -> None:
    ManagerBeat.objects.create(name=WRITTEN, beat_at=timezone.now())
    rows.holdings()


def race(rounds: int, racers: int = 3) -> Races:
    """Have so many session managers take a shard from each other, and write, so often."""
    _prepare()
    races, lock, line = Races(), threading.Lock(), threading.Barrier(racers)
    threads = [Racer(number, rounds, races, lock, line) for number in range(racers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return races


def stop_within_a_transaction() -> int:
    """Return a child that has stopped itself after a fenced write, before its end."""
    pid = os.fork()
    if pid == 0:
        connection.connect()
        ownership = Ownership()
        ownership.become({SHARD: Shard.objects.get(number=SHARD).epoch})
        with ownership.fenced(), ownership.about(ROBOT), transaction.atomic():
            ManagerBeat.objects.filter(name=WRITTEN).update(beats=-1)
            os.kill(os.getpid(), signal.SIGSTOP)
        os._exit(0)
    os.waitpid(pid, os.WUNTRACED)
    return pid


def race_as_processes(rounds: int, stop: float, racers: int = 3) -> Races:
    """Do the same as `race` in processes of their own, of which nearly always one is stopped: for
    `stop` seconds, and a second later another.

    Raises:
        RuntimeError: a process has failed.
    """
    _prepare()
    command = [sys.executable, "-m", __spec__.name, str(rounds)]
    running = [
        subprocess.Popen([*command, "--racer", str(number)], stdout=subprocess.PIPE)
        for number in range(racers)
    ]
    try:
        while living := [process for process in running if process.poll() is None]:
            stopped = random.choice(living)
            stopped.send_signal(signal.SIGSTOP)
            others = [process for process in living if process is not stopped]
            with contextlib.suppress(subprocess.TimeoutExpired):
                for process in others:
                    process.wait(stop / len(others))
            stopped.send_signal(signal.SIGCONT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                stopped.wait(1.0)
    finally:
        for process in running:
            process.kill()  # one that is stopped, too
    found = Races()
    for process in running:
        output, _ = process.communicate()
        if process.returncode:
            raise RuntimeError(f"a racer ended with {process.returncode}")
        for name, n in json.loads(output).items():
            setattr(found, name, getattr(found, name) + n)
    return found


def _race_alone(number: int, rounds: int) -> Races:
    races = Races()
    Racer(number, rounds, races, threading.Lock(), threading.Barrier(1)).run()
    return races


def race_and_stop(rounds: int) -> dict[str, object]:
    """Race as threads; then have an owner stop in the middle of a write, and another take over."""
    races = race(rounds)
    there = Shard.objects.get(number=SHARD)
    connection.close()
    if connection.vendor == "postgresql":
        connection.close_pool()  # its threads are not those of a child
    pid = stop_within_a_transaction()
    began = time.monotonic()
    rows.take_over([SHARD], [there.owner], "successor")
    waited = time.monotonic() - began
    os.kill(pid, signal.SIGCONT)
    _, code = os.waitpid(pid, 0)
    written = ManagerBeat.objects.get(name=WRITTEN).beats
    return vars(races) | {"waited": waited, "code": code, "written": written}


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("rounds", type=int)
    words.add_argument("--stop", type=float)
    words.add_argument("--racer", type=int)
    given = words.parse_args()
    if given.racer is not None:
        found = dataclasses.asdict(_race_alone(given.racer, given.rounds))
    elif given.stop is not None:
        found = dataclasses.asdict(race_as_processes(given.rounds, given.stop))
    else:
        found = race_and_stop(given.rounds)
    print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
