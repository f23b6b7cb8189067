"""Many bots, a few at a time: each begins when another has finished."""

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
from experiments.bots.view import View

GOVERNED_EVERY = 0.5  # seconds of the quick clock


@dataclass(frozen=True)
class Plan:
    """Which bots take part: `links` are paths, one a bot; each takes part `visits` times; `explore`
    makes each of them answer differently, to open every branch.
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
    """A run of many bots; `on_end` receives the diary of each as it ends."""

    plan: Plan
    on_end: Callable[[Diary], None] = lambda _diary: None
    pace: Pace | None = None
    fastest: float = 1.0
    clock: Callable[[], float] = time.time
    _active: set[BotParticipant] = field(default_factory=set)

    async def run(self) -> list[Diary]:
        """Return the diaries of all bots, in order."""
        places = asyncio.Semaphore(self.plan.at_once)
        bots = [self._run_one(number, places) for number in range(len(self.plan.links))]
        if self.pace is None:
            return list(await asyncio.gather(*bots))
        governing = asyncio.create_task(self._govern(self.pace))
        try:
            return list(await asyncio.gather(*bots))
        finally:
            governing.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await governing
            self.pace.set(1.0)

    async def _run_one(self, number: int, places: asyncio.Semaphore) -> Diary:
        plan = self.plan
        persona = Persona(number, plan.seed, plan.effects, number if plan.explore else None)
        link, ending = plan.links[number], plan.endings[number]
        bot = BotParticipant(plan.site, link, persona, ending, self.clock, plan.visits)
        async with places:
            self._active.add(bot)
            try:
                diary = await bot.take_part()
            finally:
                self._active.discard(bot)
        self.on_end(diary)
        return diary

    async def _govern(self, pace: Pace) -> None:
        """Keep the pace at which neither the bots that drive nor this process are late."""
        governor = Governor(self.fastest)
        while True:
            began = time.monotonic()
            await asyncio.sleep(GOVERNED_EVERY)
            lag = max(0.0, time.monotonic() - began - GOVERNED_EVERY)
            ages = [view.image_age for view in self._views() if view.image_age is not None]
            pace.set(governor.decide(self._round_trips(), lag, ages))

    def _round_trips(self) -> list[float]:
        """Return the round trip of each bot that drives, or how long the robot's next heartbeat is
        overdue when that is more.
        """
        now = self.clock()
        return [
            max(view.round_trip, now - view.beat[2] - BEAT)
            for view in self._views()
            if view.round_trip is not None and view.beat is not None
        ]

    def _views(self) -> list[View]:
        """Return the views of the bots that drive. A bot without a connection receives nothing,
        which does not show that the computer is late.
        """
        drives = [bot.drive for bot in self._active if bot.drive is not None]
        views = [drive.view for drive in drives if drive.cockpit.is_open]
        return [view for view in views if view.granted and view.ended is None]
