"""Visitors of a running demo: one who drives a robot, and one who waits for it and practises
meanwhile.
"""

import contextlib
import math
import re
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
from playwright.sync_api import Browser, FrameLocator, expect

from tests.support.agents.truth import Onlooker
from tests.support.browsers.running_demo import RunningDemo, demo
from tests.support.browsers.visitor import Visitor
from tests.support.patience import patient
from tests.support.sessions.site import Site, free_port

ADDRESS = re.compile(r"event=simulator_connected .*address=127\.0\.0\.1:(\d+)")
PRACTICE = "practice-1"
TURN = 0.1  # rad
HELD_LOOKS = 20  # a tenth of a second each, before a key that moves nothing is pressed again
# Of the demo: what its terminal calls each part, and a word of its command line.
PARTS = {
    "broker": ("run_broker",),
    "session manager": ("run_session_manager",),
    "web server": ("daphne",),
    "simulated Rhodon": ("run_robot", "rhodon"),
    "practice supervisor": ("run_practice",),
    "simulated Giraff": ("run_robot", "giraff"),
}


class People:
    """A demo with two visitors: Ana drives Giraff, Cy waits for it."""

    def __init__(self, running: RunningDemo, browser: Browser, port: int) -> None:
        self.demo = running
        running.link()
        self._site = Site(running.var, web_port=port)
        self.ana, self.cy = (Visitor(browser, self._site, name) for name in ("ana", "cy"))

    def close(self) -> None:
        for visitor in (self.ana, self.cy):
            visitor.context.close()
        if self._site.django_shell is not None:
            self._site.django_shell.close()

    # --- Ana ---

    def ana_sets_out(self) -> None:
        """Ana takes the robot and leaves its dock; Cy comes meanwhile and waits."""
        self.ana.drive("giraff")
        self._cy_waits()
        self._leaves_the_dock(self.ana)

    def ana_drives(self, within: float = 30.0) -> float:
        """Ana turns her robot by its keys, and presses them again as long as nothing moves; return
        the seconds that it took.
        """
        return self._turns(self.ana, "simulated-Giraff", within)

    def _leaves_the_dock(self, visitor: Visitor) -> None:
        expect(visitor.page.locator("#offer")).to_have_attribute(
            "data-word", "task.done.undock", timeout=patient(25) * 1000
        )

    def _turns(self, visitor: Visitor, log: str, within: float) -> float:
        began, deadline = time.monotonic(), time.monotonic() + patient(within)
        before = None
        while time.monotonic() < deadline:
            visitor.page.keyboard.down("ArrowLeft")
            for _ in range(HELD_LOOKS):
                now = self._theta(log)
                before = now if before is None else before  # a robot that was started anew
                if (
                    now is not None
                    and before is not None
                    and abs(math.remainder(now - before, math.tau)) > TURN
                ):
                    visitor.page.keyboard.up("ArrowLeft")
                    return time.monotonic() - began
                visitor.page.wait_for_timeout(100)
            visitor.page.keyboard.up("ArrowLeft")
        state = {name: visitor.page_data(name) for name in ("phase", "link", "transport")}
        raise AssertionError(
            f"no turn within {within} s: {state}; the demo said: {self.demo.said()}"
        )

    def _theta(self, log: str) -> float | None:
        """Return where a simulated robot really looks; None while it is not there."""
        found = ADDRESS.findall((self.demo.var / "log" / f"{log}.log").read_text(errors="replace"))
        with contextlib.suppress(OSError, AssertionError):
            if found:
                onlooker = Onlooker(int(found[-1]))
                with contextlib.closing(onlooker):
                    return onlooker.truth().theta
        return None

    # --- Cy ---

    def _cy_waits(self) -> None:
        self.cy.open("giraff", go=True)
        expect(self.cy.page.locator("#card")).to_have_attribute("data-card", "queued.next")

    @property
    def _frame(self) -> FrameLocator:
        return self.cy.page.frame_locator("#practice-frame")

    def cy_practises(self) -> float:
        """Cy asks for a practice robot, drives it, and goes back to the queue; return the seconds
        until it moved.
        """
        began = time.monotonic()
        self.cy_begins_to_practise()
        moving = self._frame.locator(
            "#offer[data-word='task.undock'], #offer[data-word='task.done.undock']"
        )
        expect(moving).to_be_visible(timeout=patient(15) * 1000)
        took = time.monotonic() - began
        self.cy_stops_practising()
        return took

    def cy_stops_practising(self) -> None:
        self.cy.page.locator("#practice-end").click()
        expect(self.cy.page.locator("#card")).to_have_attribute("data-card", "queued.next")

    def cy_begins_to_practise(self) -> None:
        self.cy.page.locator("#card-main").click()
        expect(self.cy.page.locator("#practice")).to_be_visible(timeout=patient(40) * 1000)
        self.cy_sees_the_practice_robot()

    def cy_sees_the_practice_robot(self) -> None:
        expect(self._frame.locator("#drive-page[data-playing]")).to_be_visible(
            timeout=patient(40) * 1000
        )

    def cy_sees_no_practice_robot(self) -> None:
        expect(self._frame.locator("#drive-page:not([data-playing])")).to_be_visible(
            timeout=patient(20) * 1000
        )

    # --- who is killed ---

    def kill(self, *parts: str) -> list[str]:
        """Kill parts of the demo at once, and return what its terminal says of each death, when all
        are back.
        """
        return self.kill_members({part: self.demo.member(*PARTS[part]) for part in parts})

    def kill_members(self, members: dict[str, psutil.Process]) -> list[str]:
        """Kill processes by the parts that cannot be without them."""
        said = len(self.demo.said())
        for process in members.values():
            process.kill()
        deaths = [
            self.demo.waits_to_say(
                rf"The {part} ended: .*Starting it again in .* s\.", 10, said
            ).group(0)
            for part in members
        ]
        for part in members:
            self.demo.waits_to_say(rf"The {part} is back after .* s\.", 40, said)
        return deaths


@contextlib.contextmanager
def demo_with_people(var: Path, browser: Browser, **settings: str) -> Iterator[People]:
    port = free_port()
    with demo(var, "--port", str(port), background=True, **settings) as running:
        people = People(running, browser, port)
        try:
            yield people
        finally:
            people.close()
