"""One session of a bot with the robot: it waits for its turn, then drives by the cues to the end,
or until its own ending is due.
"""

import asyncio
import contextlib
import json
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from websockets.exceptions import WebSocketException

from experiments.bots.browser import Browser, BrowserError
from experiments.bots.cockpit import Cockpit
from experiments.bots.diary import Leg
from experiments.bots.driver import STAND, Driver, Guide, Intent, SpeedSetting
from experiments.bots.endings import LEAVES_AT_ONCE, Ending
from experiments.bots.persona import DRIVE, Persona
from experiments.bots.view import View
from robots.api import floorplan
from robots.api.geometry import Pose2D
from robots.api.messages import ENDED

# Seconds.
TICK = 0.1
WAIT_FOR_ROBOT = 3600.0
WAIT_FOR_PICTURE = 40.0
ASK_AGAIN = 15.0
SURPRISE = 2.0  # before a bot that pressed stop drives on
SETTLED = 60.0  # after which the place of a bot that saw nothing has been given up
WATCHES = 5.0  # of a bot that never moves the robot
PRACTISES = 20.0
DRIVES = 10.0  # of a bot that then lets the time run out
LONGEST_DRIVE = 3600.0
SLOWEST_END = 30.0
AWAY = 6.0  # without a network, well within the grace period
AWAY_TOO_LONG = 150.0  # beyond the grace period of a study, which is two minutes
NO_CONNECTION = 90.0  # in which a session that gets no connection is ended
CONTROLLERS = ("keyboard", "mouse", "touch", "stick", "gamepad")
ASKS_AGAIN_AFTER = frozenset({"offline", "paused", "closed"})  # reasons of a refusal


@dataclass(eq=False)
class BotDrive:
    """One session, the bot's drive of this `number` (from 1). `config` is that of the page
    (sessions.views.page_config, and under `study` experiments.participation.drive_config); `clock`
    gives Unix seconds.
    """

    browser: Browser
    config: dict[str, Any]
    persona: Persona
    ending: Ending
    clock: Callable[[], float] = time.time
    number: int = 1
    leg: Leg = field(default_factory=Leg)
    _photo: str | None = None
    _discarded: str | None = None  # the photo that is not kept
    _answered: tuple[str | None, float] = (None, 0.0)  # a photo, and when
    _began: float | None = None
    _has_happened: bool = False  # what the ending demands midway

    def __post_init__(self) -> None:
        self.study: dict[str, Any] = self.config.get("study", {})
        self._is_practice = self.study.get("kind") == "practice"
        # a hidden operator drives, and the page has no controllers
        self._is_driven = self.study.get("controllers") == []
        sheet = self.config.get("factsheet") or {}
        self.limits = sheet.get("limits", {})
        self.series = sheet.get("series", self.config["robot"])
        laser = sheet.get("laser") or {}
        self._laser = Pose2D(*(laser.get(name, 0.0) for name in ("x", "y", "theta")))
        self.cockpit = self._page()

    def _page(self) -> Cockpit:
        """Return a page that was just opened."""
        allowed = self.study.get("controllers") or CONTROLLERS
        choices = (self.persona.method, *CONTROLLERS)
        method = next((one for one in choices if one in allowed), "keyboard")
        page = Cockpit(self.browser, self.config["socket"], method, self.clock)  # type: ignore[arg-type]
        page.view.laser = self._laser
        page.is_mute = self.ending in {Ending.GETS_NO_CONNECTION, *LEAVES_AT_ONCE}
        return page

    @property
    def view(self) -> View:
        return self.cockpit.view

    async def run(self) -> Leg:
        leg = self.leg
        try:
            driver = await self._prepare()
            await self.cockpit.connect()
            if await self._wait_for_turn():
                driver.fastest = self._fastest()
                await self._drive(driver)
                leg.closed, leg.no_route = tuple(sorted(driver.closed)), driver.no_route
        except (WebSocketException, OSError, BrowserError) as error:
            leg.reason = f"connection: {error}"
        finally:
            with contextlib.suppress(WebSocketException, OSError):
                await self.cockpit.close()
        view, leg.circumstances = self.view, self._circumstances()
        leg.session, leg.seconds = view.session or "", self._driving_seconds()
        leg.passed, leg.doors = tuple(view.task.passed), tuple(view.task.doors)
        leg.outcome = view.task.outcome or (view.ended.outcome if view.ended is not None else "")
        leg.reason = leg.reason or (view.ended.reason if view.ended is not None else "")
        leg.refused, leg.pictures, leg.round_trip = dict(view.denied), view.frames, view.round_trip
        return leg

    async def _prepare(self) -> Driver:
        answer = await asyncio.to_thread(self.browser.open, self.config["floorplan"])
        plan = floorplan.decode(json.dumps(json.loads(answer.body)["plan"]))
        driver = Driver(plan, Guide.of(self.study, plan, self.series), self._fastest())
        driver.practises, driver.skips_photo = self._is_practice, self.ending == Ending.SKIPS_PHOTO
        driver.docks_early = self.ending == Ending.DOCKS_EARLY and not self._is_practice
        return driver

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
        view, study = self.view, self.study
        seen = max(view.assists - {"off"}, default="off")
        return {
            "robot": str(self.series),
            "assist": str(view.assist or study.get("assist") or seen),
            "interface": str(view.interface or study.get("interface") or ""),
            DRIVE: str(self.number),
        }

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
        limit = self._began + min(LONGEST_DRIVE, 60.0 * minutes + SLOWEST_END)
        while self.view.ended is None and self.clock() < limit:
            if self.cockpit.closed is not None:
                await self.cockpit.come_back()
            if await self._act_out_ending():
                return
            self._do(driver.decide(self.view, self.clock()), driver)
            await asyncio.sleep(TICK)
        self.cockpit.steer(STAND)
        if self.view.ended is None:
            await self._leave()

    def _do(self, intent: Intent, driver: Driver) -> None:
        cue = self.view.task.cue
        if cue and self.leg.cues[-1:] != [cue]:
            self.leg.cues.append(cue)
            self.cockpit.note("cue_shown", cue=cue)
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
        before, at = self._answered
        if about is None or (about == before and self.clock() - at < ASK_AGAIN):
            return
        self._answered = (about, self.clock())
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
        is_idle = self.ending == Ending.LETS_TIME_RUN_OUT and self._driving_seconds() > DRIVES
        return STAND if self._is_driven or is_stopped or is_idle else speed

    def _driving_seconds(self) -> float:
        return self.clock() - self._began if self._began is not None else 0.0

    # --- endings ----------------------------------------------------------------------------------

    async def _act_out_ending(self) -> bool:
        """Do what the ending demands once it is due; True when the session is over for the bot."""
        if self._is_practice and self._driving_seconds() > PRACTISES:
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
        """Continue the session on the page loaded again, or on a second one beside it, which knows
        only the session's id.
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
