"""Visitors of a running demo: one drives a robot, another waits for it and practises."""

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
HELD_POLLS = 20  # of 0.1 s each, before a key that moves nothing is pressed again
# The parts of the demo: their name on the terminal, and words of their command line.
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
        """Ana takes the robot, Cy joins the queue, and the robot leaves its dock."""
        self.ana.drive("giraff")
        self.cy.open("giraff", go=True)
        expect(self.cy.page.locator("#card")).to_have_attribute("data-card", "queued.next")
        expect(self.ana.page.locator("#offer")).to_have_attribute(
            "data-word", "task.done.undock", timeout=patient(25) * 1000
        )

    def ana_drives(self, within: float = 30.0) -> None:
        """Ana turns her robot with a key, which she presses again while nothing moves."""
        deadline, before = time.monotonic() + patient(within), None
        while time.monotonic() < deadline:
            self.ana.page.keyboard.down("ArrowLeft")
            for _ in range(HELD_POLLS):
                now = self._theta("simulated-Giraff")
                before = now if before is None else before  # the robot may have been restarted
                if now is not None and abs(math.remainder(now - before, math.tau)) > TURN:
                    self.ana.page.keyboard.up("ArrowLeft")
                    return
                self.ana.page.wait_for_timeout(100)
            self.ana.page.keyboard.up("ArrowLeft")
        state = {name: self.ana.page_data(name) for name in ("phase", "link", "transport")}
        raise AssertionError(f"no turn within {within} s: {state}; the demo: {self.demo.said()}")

    def _theta(self, log: str) -> float | None:
        """Return the true heading of a simulated robot; None while it does not run."""
        found = ADDRESS.findall((self.demo.var / "log" / f"{log}.log").read_text(errors="replace"))
        with contextlib.suppress(OSError, AssertionError):
            if found:
                onlooker = Onlooker(int(found[-1]))
                with contextlib.closing(onlooker):
                    return onlooker.truth().theta
        return None

    # --- Cy ---

    @property
    def _frame(self) -> FrameLocator:
        return self.cy.page.frame_locator("#practice-frame")

    def cy_practises(self) -> None:
        """Cy takes a practice robot, sees it move, and returns to the queue."""
        self.cy_begins_to_practise()
        moving = self._frame.locator(
            "#offer[data-word='task.undock'], #offer[data-word='task.done.undock']"
        )
        expect(moving).to_be_visible(timeout=patient(15) * 1000)
        self.cy_stops_practising()

    def cy_stops_practising(self) -> None:
        self.cy.page.locator("#practice-end").click()
        expect(self.cy.page.locator("#card")).to_have_attribute("data-card", "queued.next")

    def cy_begins_to_practise(self) -> None:
        self.cy.page.locator("#card-main").click()
        expect(self.cy.page.locator("#practice")).to_be_visible(timeout=patient(40) * 1000)
        self.cy_sees_the_practice_robot()

    def cy_sees_the_practice_robot(self) -> None:
        playing = self._frame.locator("#drive-page[data-playing]")
        expect(playing).to_be_visible(timeout=patient(40) * 1000)

    # --- the parts ---

    def kill(self, *parts: str) -> list[str]:
        """Kill parts of the demo at once; return its sentence about each once all run again."""
        return self.kill_members({part: self.demo.member(*PARTS[part]) for part in parts})

    def kill_members(self, members: dict[str, psutil.Process]) -> list[str]:
        """Kill a process of each of these parts."""
        said = len(self.demo.said())
        for process in members.values():
            process.kill()
        ended = "The {} ended: .*Starting it again in .* s\\."
        deaths = [self.demo.waits_to_say(ended.format(part), 10, said)[0] for part in members]
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
