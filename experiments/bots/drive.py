"""One visit of a bot to the robot: waits for its turn, drives by the cues to the end, or until its
own ending comes.
"""

import asyncio
import contextlib
import json
import math
import time
import uuid
from collections.abc import Callable
from typing import Any

from experiments.bots.browser import Browser, BrowserError
from experiments.bots.cockpit import Cockpit
from experiments.bots.diary import Leg
from experiments.bots.driver import Driver, Guide, Intent
from experiments.bots.endings import Ending
from experiments.bots.persona import DRIVE, Persona
from experiments.bots.socket import SocketClosed
from experiments.bots.steering import STAND, SpeedSetting
from experiments.bots.view import View
from robots.api import floorplan
from robots.api.geometry import Pose2D
from robots.api.messages import ENDED

TICK = 0.1
WAIT_FOR_ROBOT = 3600.0
WAIT_FOR_PICTURE = 40.0
ASK_AGAIN = 15.0
SURPRISE = 2.0
OVER = 3600.0  # seconds that no drive takes
SLOWEST_END = 30.0
AWAY = 6.0  # seconds without a network, well within the time of grace
AWAY_TOO_LONG = 150.0  # beyond the grace of a study, which is two minutes
NO_CONNECTION = 90.0  # seconds in which a visit that gets no connection is ended
CONTROLLERS = ("keyboard", "mouse", "touch", "stick", "gamepad")


class BotDrive:
    """One visit.

    Args:
        browser: whose.
        config: what the page is told (sessions.views.page_config, and under `study`
            experiments.participation.drive_config).
        persona: who drives.
        ending: how it ends.
        clock: Unix seconds.
        number: which of the bot's drives it is, from 1.
    """

    def __init__(
        self,
        browser: Browser,
        config: dict[str, Any],
        persona: Persona,
        ending: Ending,
        clock: Callable[[], float] = time.time,
        number: int = 1,
    ) -> None:
        self.browser, self.config, self.persona, self.ending, self.clock = (
            browser,
            config,
            persona,
            ending,
            clock,
        )
        self.number = number
        self.study: dict[str, Any] = config.get("study", {})
        # a hidden operator drives, and the page has no controllers
        self._is_driven = self.study.get("controllers") == []
        sheet = config.get("factsheet") or {}
        self.limits = sheet.get("limits", {})
        self.series = sheet.get("series", config["robot"])
        laser = sheet.get("laser") or {}
        self._laser = Pose2D(laser.get("x", 0.0), laser.get("y", 0.0), laser.get("theta", 0.0))
        self.cockpit = self._page()
        self.leg = Leg()
        self._photo: str | None = None
        self._answered: str | None = None
        self._answered_at = 0.0
        self._began: float | None = None
        self._has_happened = False
        self._thrown_away: str | None = None  # the photo that is not kept

    def _page(self) -> Cockpit:
        """Return a page that knows nothing yet."""
        allowed, wanted = self.study.get("controllers") or CONTROLLERS, self.persona.method
        method = (
            wanted
            if wanted in allowed
            else next((name for name in CONTROLLERS if name in allowed), "keyboard")
        )
        address = self.config["socket"]
        page = Cockpit(self.browser, address, method, self.clock)  # type: ignore[arg-type]
        page.view.laser, page.is_mute = self._laser, self.ending == Ending.GETS_NO_CONNECTION
        return page

    @property
    def view(self) -> View:
        """What is known."""
        return self.cockpit.view

    async def run(self) -> Leg:
        """BotDrive and return what there is to tell."""
        try:
            driver = await self._prepare()
            await self.cockpit.connect()
            if await self._wait_for_turn():
                driver.fastest = self._fastest()
                await self._drive(driver)
                self.leg.closed, self.leg.no_way = tuple(sorted(driver.closed)), driver.no_way
        except (SocketClosed, OSError, BrowserError) as error:
            self.leg.reason = f"connection: {error}"
        finally:
            with contextlib.suppress(SocketClosed, OSError):
                await self.cockpit.close()
        return self._tell()

    async def _prepare(self) -> Driver:
        answer = await asyncio.to_thread(self.browser.get, self.config["floorplan"])
        plan = floorplan.decode(json.dumps(json.loads(answer.body)["plan"]))
        skips, early, practises = (
            self.ending == Ending.SKIPS_PHOTO,
            self.ending == Ending.DOCKS_EARLY,
            self.study.get("kind") == "practice",
        )
        guide = Guide.of(self.study, plan, self.series)
        return Driver(
            plan,
            guide,
            self._fastest(),
            skips_photo=skips,
            practises=practises,
            docks_early=early and not practises,
        )

    def _fastest(self) -> SpeedSetting:
        """Return how fast the bot drives, which depends on what it sees."""
        pace = self.persona.pace(self._circumstances())
        linear, angular = self.limits.get("linear", 0.5), self.limits.get("angular", 0.7)
        return SpeedSetting(pace * linear, 0.9 * angular)

    def _circumstances(self) -> dict[str, str]:
        """What a driver sees of a condition, the robot, the assistance in force and the page, and
        which of their drives it is. A page that is made before the first grant does not know the
        condition yet: the terms that come with the grant do.
        """
        seen = max(self.view.assists - {"off"}, default="off")
        return {
            "robot": str(self.series),
            "assist": str(self.view.assist or self.study.get("assist") or seen),
            "interface": str(self.view.interface or self.study.get("interface") or ""),
            DRIVE: str(self.number),
        }

    # --- the queue --------------------------------------------------------------------------------

    async def _wait_for_turn(self) -> bool:
        began = self.clock()
        self.cockpit.take()
        while self.clock() - began < WAIT_FOR_ROBOT:
            news = await self.cockpit.until(
                lambda: self.view.granted or self.view.turn or self.view.refused or self.view.ended,
                ASK_AGAIN,
            )
            if self.view.granted:
                self.leg.waited = self.clock() - began
                return True
            if self.cockpit.closed is not None or self.view.ended is not None:
                return False
            if self.ending == Ending.LEAVES_QUEUE and self.view.queued:
                self.cockpit.leave()
                await self.cockpit.until(lambda: self.view.ended, ASK_AGAIN)
                return False
            if self.view.refused:
                self.leg.reason, self.view.refused = self.view.refused, ""
                if self.leg.reason not in {"offline", "paused", "closed"}:
                    return False
                await asyncio.sleep(ASK_AGAIN)
                self.cockpit.take()
            elif self.view.turn or (not news and not self.view.queued):
                self.cockpit.take()
        return False

    # --- the drive --------------------------------------------------------------------------------

    async def _drive(self, driver: Driver) -> None:
        if self.ending in {Ending.LEAVES_QUEUE, Ending.LEAVES_AT_DOCK}:
            await self._leave()
            return
        if self.ending == Ending.GETS_NO_CONNECTION:
            await self.cockpit.until(lambda: self.view.ended, NO_CONNECTION)
            return
        await self.cockpit.until(lambda: self.view.frames and self.view.pose, WAIT_FOR_PICTURE)
        self._began = self.clock()
        limit = self._began + min(
            OVER, 60.0 * float(self.study.get("minutes") or 15.0) + SLOWEST_END
        )
        while self.view.ended is None and self.clock() < limit:
            if self.cockpit.closed is not None:
                await self.cockpit.come_back()
            if await self._ends_its_own_way():
                return
            self._do(driver.decide(self.view, self.clock()), driver)
            await asyncio.sleep(TICK)
        self.cockpit.steer(STAND)
        if self.view.ended is None:
            await self._leave()

    def _do(self, intent: Intent, driver: Driver) -> None:
        self._note_cue()
        self.cockpit.steer(self._with_pauses(intent.speed))
        if intent.take and self._photo is None:
            self._photo = self.cockpit.photo()
        status = self.view.actions.get(self._photo or "")
        if status is not None and status.status in ENDED and status.status != "FINISHED":
            self._photo = None
            driver.photo_failed()
        if intent.answer and self.view.task.window != "shut":
            self._answer(intent.answer, driver)

    def _answer(self, choice: str, driver: Driver) -> None:
        """Say once what becomes of the photo; a skip needs none."""
        about = self.view.task.photo or self._photo or ("" if choice == "skip" else None)
        if about is None or (
            about == self._answered and self.clock() - self._answered_at < ASK_AGAIN
        ):
            return
        self._answered, self._answered_at = about, self.clock()
        if (
            self.ending == Ending.TAKES_PHOTO_AGAIN
            and choice == "keep"
            and self._thrown_away in {None, about}
        ):
            choice, self._thrown_away, self._photo = "again", about, None
            driver.photo_failed()
        self.cockpit.note("photo_answer", id=about or uuid.uuid4().hex, choice=choice)

    def _with_pauses(self, speed: SpeedSetting) -> SpeedSetting:
        """Let go where somebody else drives, and where the robot waits for that, as the page says;
        who lets the time run out drives for a while and then looks at the picture.
        """
        if self._is_driven:
            return STAND
        if self.view.state is not None and self.view.state.safety.inhibited == "stopped":
            return STAND
        if self.ending == Ending.LETS_TIME_RUN_OUT and self._driven_for() > 30.0:
            return STAND
        return speed

    def _driven_for(self) -> float:
        return self.clock() - self._began if self._began is not None else 0.0

    def _note_cue(self) -> None:
        cue = self.view.task.cue
        if cue and (not self.leg.cues or self.leg.cues[-1] != cue):
            self.leg.cues.append(cue)
            self.cockpit.note("cue_shown", cue=cue)

    # --- endings ----------------------------------------------------------------------------------

    async def _ends_its_own_way(self) -> bool:
        """Do what the ending says once it is time; True when the visit is over for the bot."""
        is_midway = len(self.view.task.passed) >= max(
            1, (len(self.study.get("checkpoints", ())) - 1) // 2
        )
        if self.study.get("kind") == "practice" and self._driven_for() > 20.0:
            await self._leave()
            return True
        if not is_midway:
            return False
        if self.ending == Ending.LEAVES_MIDWAY:
            await self._leave()
        elif self.ending == Ending.CLOSES_PAGE:
            await self.cockpit.close()
        elif self.ending == Ending.STAYS_AWAY:
            await self.cockpit.lose_network()
            await asyncio.sleep(AWAY_TOO_LONG)
        else:
            if not self._has_happened:
                self._has_happened = True
                await self._happens()
            return False
        return True

    async def _happens(self) -> None:
        """What befalls somebody on the way who drives on afterwards."""
        if self.ending == Ending.LOSES_NETWORK:
            await self.cockpit.lose_network()
            await asyncio.sleep(AWAY)
            await self.cockpit.come_back()
        elif self.ending == Ending.PRESSES_STOP:
            self.cockpit.stop()
            await self.cockpit.until(lambda: False, SURPRISE)
        elif self.ending in {Ending.RELOADS_PAGE, Ending.OPENS_SECOND_PAGE}:
            await self._open_another_page(self.cockpit)

    async def _open_another_page(self, old: Cockpit) -> None:
        """Go on with the visit on a page that knows nothing but which visit it is: the same one
        loaded again, or a second one beside it.
        """
        new = self._page()
        new.view.session = old.view.session
        if self.ending == Ending.RELOADS_PAGE:
            await old.close()
        await new.connect()
        new.take(takeover=True)
        await new.until(lambda: new.view.granted, ASK_AGAIN)
        self.cockpit = new
        await old.close()

    async def _leave(self) -> None:
        self.cockpit.leave()
        await self.cockpit.until(lambda: self.view.ended, SLOWEST_END)

    def _tell(self) -> Leg:
        view, leg = self.view, self.leg
        leg.session = view.session or ""
        leg.seconds = self._driven_for()
        leg.passed, leg.doors = tuple(view.task.passed), tuple(view.task.doors)
        leg.outcome = view.task.outcome or (view.ended.outcome if view.ended is not None else "")
        leg.reason = leg.reason or (view.ended.reason if view.ended is not None else "")
        leg.refused, leg.pictures = dict(view.denied), view.frames
        leg.round_trip = (
            view.round_trip
            if view.round_trip is not None and math.isfinite(view.round_trip)
            else None
        )
        leg.circumstances = self._circumstances()
        return leg
