"""One session of a bot with the robot: it waits for its turn, then drives by the cues to the end,
or until its own ending is due.
"""

import asyncio
import contextlib
import json
import time
import uuid
from collections.abc import Callable
from typing import Any

from websockets.exceptions import WebSocketException

from experiments.bots.browser import Browser, BrowserError
from experiments.bots.cockpit import Cockpit
from experiments.bots.diary import Leg
from experiments.bots.driver import Driver, Guide, Intent
from experiments.bots.endings import LEAVES_AT_ONCE, Ending
from experiments.bots.persona import DRIVE, Persona
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
SETTLED = 60.0  # seconds after which the place of a bot that saw nothing has been given up
WATCHES = 5.0  # seconds of a bot that never moves the robot
DRIVES = 10.0  # seconds of a bot that then lets the time run out
OVER = 3600.0  # seconds that no drive takes
SLOWEST_END = 30.0
AWAY = 6.0  # seconds without a network, well within the grace period
AWAY_TOO_LONG = 150.0  # beyond the grace period of a study, which is two minutes
NO_CONNECTION = 90.0  # seconds in which a session that gets no connection is ended
CONTROLLERS = ("keyboard", "mouse", "touch", "stick", "gamepad")
ASKS_AGAIN_AFTER = frozenset({"offline", "paused", "closed"})  # reasons of a refusal


class BotDrive:
    """One session.

    Args:
        browser: the bot's.
        config: of the page (sessions.views.page_config, and under `study`
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
        self.browser, self.config, self.persona = browser, config, persona
        self.ending, self.clock, self.number = ending, clock, number
        self.study: dict[str, Any] = config.get("study", {})
        # a hidden operator drives, and the page has no controllers
        self._is_driven = self.study.get("controllers") == []
        sheet = config.get("factsheet") or {}
        self.limits, self.series = sheet.get("limits", {}), sheet.get("series", config["robot"])
        laser = sheet.get("laser") or {}
        self._laser = Pose2D(laser.get("x", 0.0), laser.get("y", 0.0), laser.get("theta", 0.0))
        self.cockpit = self._page()
        self.leg = Leg()
        self._photo: str | None = None
        self._answered: str | None = None
        self._answered_at = 0.0
        self._began: float | None = None
        self._has_happened = False
        self._discarded: str | None = None  # the photo that is not kept

    def _page(self) -> Cockpit:
        """Return a page that was just opened."""
        allowed, wanted = self.study.get("controllers") or CONTROLLERS, self.persona.method
        choices = (wanted, *CONTROLLERS, "keyboard")
        method = next((one for one in choices if one in allowed), "keyboard")
        page = Cockpit(self.browser, self.config["socket"], method, self.clock)  # type: ignore[arg-type]
        page.view.laser = self._laser
        page.is_mute = self.ending in {Ending.GETS_NO_CONNECTION, *LEAVES_AT_ONCE}
        return page

    @property
    def view(self) -> View:
        return self.cockpit.view

    async def run(self) -> Leg:
        try:
            driver = await self._prepare()
            await self.cockpit.connect()
            if await self._wait_for_turn():
                driver.fastest = self._fastest()
                await self._drive(driver)
                self.leg.closed, self.leg.no_way = tuple(sorted(driver.closed)), driver.no_way
        except (WebSocketException, OSError, BrowserError) as error:
            self.leg.reason = f"connection: {error}"
        finally:
            with contextlib.suppress(WebSocketException, OSError):
                await self.cockpit.close()
        return self._log()

    async def _prepare(self) -> Driver:
        answer = await asyncio.to_thread(self.browser.get, self.config["floorplan"])
        plan = floorplan.decode(json.dumps(json.loads(answer.body)["plan"]))
        is_practice = self.study.get("kind") == "practice"
        return Driver(
            plan,
            Guide.of(self.study, plan, self.series),
            self._fastest(),
            skips_photo=self.ending == Ending.SKIPS_PHOTO,
            practises=is_practice,
            docks_early=self.ending == Ending.DOCKS_EARLY and not is_practice,
        )

    def _fastest(self) -> SpeedSetting:
        """Return how fast the bot drives, which depends on what it sees."""
        pace = self.persona.pace(self._circumstances())
        linear, angular = self.limits.get("linear", 0.5), self.limits.get("angular", 0.7)
        return SpeedSetting(pace * linear, 0.9 * angular)

    def _circumstances(self) -> dict[str, str]:
        """Return what a driver sees of a condition: the robot, the assistance in force and the
        page; and which of the bot's drives it is. A page that was made before the first grant does
        not know the condition yet: the terms of the grant do.
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
        began, view = self.clock(), self.view
        self.cockpit.take()
        while self.clock() - began < WAIT_FOR_ROBOT:
            has_changed = await self.cockpit.until(
                lambda: view.granted or view.turn or view.refused or view.ended, ASK_AGAIN
            )
            if view.granted:
                self.leg.waited = self.clock() - began
                return True
            if self.cockpit.closed is not None or view.ended is not None:
                return False
            if self.ending == Ending.LEAVES_QUEUE and view.queued:
                self.cockpit.leave()
                await self.cockpit.until(lambda: view.ended, ASK_AGAIN)
                return False
            if view.refused:
                self.leg.reason, view.refused = view.refused, ""
                if self.leg.reason not in ASKS_AGAIN_AFTER:
                    return False
                await asyncio.sleep(ASK_AGAIN)
                self.cockpit.take()
            elif view.turn or not (has_changed or view.queued):
                self.cockpit.take()
        return False

    # --- the drive --------------------------------------------------------------------------------

    async def _drive(self, driver: Driver) -> None:
        if self.ending in LEAVES_AT_ONCE:
            await self._leave()
            if self.ending == Ending.TAKES_ROBOT_AGAIN:
                await asyncio.sleep(SETTLED)
            return
        if self.ending == Ending.GETS_NO_CONNECTION:
            await self.cockpit.until(lambda: self.view.ended, NO_CONNECTION)
            return
        await self.cockpit.until(lambda: self.view.frames and self.view.pose, WAIT_FOR_PICTURE)
        if self.ending == Ending.NEVER_MOVES:
            await self.cockpit.until(lambda: self.view.ended, WATCHES)
            await self._leave()
            return
        self._began = self.clock()
        minutes = float(self.study.get("minutes") or 15.0)
        limit = self._began + min(OVER, 60.0 * minutes + SLOWEST_END)
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
        """Answer once about each photo; to skip needs none."""
        about = self.view.task.photo or self._photo or ("" if choice == "skip" else None)
        is_recent = self.clock() - self._answered_at < ASK_AGAIN
        if about is None or (about == self._answered and is_recent):
            return
        self._answered, self._answered_at = about, self.clock()
        again = self.ending == Ending.TAKES_PHOTO_AGAIN and self._discarded in {None, about}
        if again and choice == "keep":
            choice, self._discarded, self._photo = "again", about, None
            driver.photo_failed()
        self.cockpit.note("photo_answer", id=about or uuid.uuid4().hex, choice=choice)

    def _with_pauses(self, speed: SpeedSetting) -> SpeedSetting:
        """Release the controller where an operator drives, and where the robot waits for that after
        a stop. A bot that lets the time run out drives for a while, then only watches.
        """
        state = self.view.state
        is_stopped = state is not None and state.safety.inhibited == "stopped"
        is_idle = self.ending == Ending.LETS_TIME_RUN_OUT and self._seconds_driven() > DRIVES
        return STAND if self._is_driven or is_stopped or is_idle else speed

    def _seconds_driven(self) -> float:
        return self.clock() - self._began if self._began is not None else 0.0

    def _note_cue(self) -> None:
        cue = self.view.task.cue
        if cue and self.leg.cues[-1:] != [cue]:
            self.leg.cues.append(cue)
            self.cockpit.note("cue_shown", cue=cue)

    # --- endings ----------------------------------------------------------------------------------

    async def _ends_its_own_way(self) -> bool:
        """Do what the ending demands once it is due; True when the session is over for the bot."""
        if self.study.get("kind") == "practice" and self._seconds_driven() > 20.0:
            await self._leave()
            return True
        checkpoints = len(self.study.get("checkpoints", ()))
        if len(self.view.task.passed) < max(1, (checkpoints - 1) // 2):
            return False
        match self.ending:
            case Ending.LEAVES_MIDWAY:
                await self._leave()
            case Ending.CLOSES_PAGE:
                await self.cockpit.close()
            case Ending.STAYS_AWAY:
                await self.cockpit.lose_network()
                await asyncio.sleep(AWAY_TOO_LONG)
            case _:
                if not self._has_happened:
                    self._has_happened = True
                    await self._interrupt()
                return False
        return True

    async def _interrupt(self) -> None:
        """Do what the ending demands midway, after which the bot drives on."""
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
        """Continue the session on a page that knows only which session it is: the same page loaded
        again, or a second one beside it.
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

    def _log(self) -> Leg:
        view, leg = self.view, self.leg
        leg.session = view.session or ""
        leg.seconds = self._seconds_driven()
        leg.passed, leg.doors = tuple(view.task.passed), tuple(view.task.doors)
        leg.outcome = view.task.outcome or (view.ended.outcome if view.ended is not None else "")
        leg.reason = leg.reason or (view.ended.reason if view.ended is not None else "")
        leg.refused, leg.pictures, leg.round_trip = dict(view.denied), view.frames, view.round_trip
        leg.circumstances = self._circumstances()
        return leg
