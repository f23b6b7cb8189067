"""Many bots, a few at a time: each comes when another has left, as people do over a month."""

import asyncio
import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from experiments.bots.cockpit import BEAT
from experiments.bots.diary import Diary
from experiments.bots.endings import Ending
from experiments.bots.pace import Governor, Pace
from experiments.bots.participant import BotParticipant
from experiments.bots.persona import Effect, Persona

GOVERNED_EVERY = 0.5  # seconds of the quick clock


@dataclass(frozen=True)
class Plan:
    """What a crowd is made of. `links` are paths, one a bot; `explore` makes each answer
    differently, to open every branch.

    Each takes part `visits` times.
    """

    site: str
    links: Sequence[str]
    endings: Sequence[Ending]
    seed: int
    at_once: int = 2
    effects: Sequence[Effect] = ()
    explore: bool = False
    visits: int = 1


@dataclass
class BotGroup:
    """A run of many bots. `told` hears of each one's diary as it ends."""

    plan: Plan
    told: Callable[[Diary], None] = lambda _diary: None
    pace: Pace | None = None
    fastest: float = 1.0
    clock: Callable[[], float] = time.time
    _living: set[BotParticipant] = field(default_factory=set)

    async def run(self) -> list[Diary]:
        """Let all of them take part, and return their diaries in order."""
        places = asyncio.Semaphore(self.plan.at_once)
        governing = asyncio.create_task(self._govern()) if self.pace is not None else None
        try:
            return list(
                await asyncio.gather(
                    *(self._one(number, places) for number in range(len(self.plan.links)))
                )
            )
        finally:
            if governing is not None and self.pace is not None:
                governing.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await governing
                self.pace.set(1.0)

    async def _one(self, number: int, places: asyncio.Semaphore) -> Diary:
        persona = Persona(
            number, self.plan.seed, self.plan.effects, number if self.plan.explore else None
        )
        bot = BotParticipant(
            self.plan.site,
            self.plan.links[number],
            persona,
            self.plan.endings[number],
            self.clock,
            self.plan.visits,
        )
        async with places:
            self._living.add(bot)
            try:
                diary = await bot.take_part()
            finally:
                self._living.discard(bot)
        self.told(diary)
        return diary

    async def _govern(self) -> None:
        """Keep the pace where nobody is late: neither those who drive nor this process itself."""
        assert self.pace is not None
        governor, asked = Governor(self.fastest), GOVERNED_EVERY
        while True:
            begun = time.monotonic()
            await asyncio.sleep(asked)
            lag = max(0.0, time.monotonic() - begun - asked)
            self.pace.set(governor.decide(self._round_trips(), lag))

    def _round_trips(self) -> list[float]:
        """Return the round trip of each who drives, or how long the robot's next heartbeat is
        overdue when that is more.

        Who is away hears nothing, and that is nobody's lateness.
        """
        now = self.clock()
        views = [
            bot.drive.view
            for bot in self._living
            if bot.drive is not None and bot.drive.cockpit.is_open
        ]
        driving = [
            view
            for view in views
            if view.granted and view.ended is None and view.round_trip is not None
        ]
        return [max(view.round_trip or 0.0, now - view.beats[-1][2] - BEAT) for view in driving]
