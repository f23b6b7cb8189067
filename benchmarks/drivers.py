"""Drives through the whole office with every controller in a real browser: out of the dock, through
both doors to the far end, and back.

The scripted driver sees only what the page shows (benchmarks/driving/scripted_visitor.py). For
each controller the table has seconds, metres, contacts with walls, furniture and doors, presses on
the video, and presses at its sides to turn. `keyboard mouse` runs these two alone. It takes some
minutes, because the robot drives in real time. The only bound is that there is no contact.
"""

import argparse
import os
import sys
from collections.abc import Callable
from typing import Any

import django
from playwright.sync_api import Browser, Page, sync_playwright

from benchmarks.table import Figure, keep

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "tests.settings")

FPS = 10.0
WITHIN = 400.0  # seconds, on a machine with nothing else to do
WIDE = {"viewport": {"width": 1280, "height": 800}}
TABLET = {"viewport": {"width": 820, "height": 1180}, "has_touch": True, "is_mobile": True}
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
PLAYING = "#drive-page[data-playing][data-link=live]"


def by_hand(hands: Callable[[Page], Any]) -> Callable[[Any, Any], float]:
    return lambda tour, _site: tour.steer(hands(tour.page), WITHIN)


def on_picture(hand: Callable[[Page], Any]) -> Callable[[Any, Any], float]:
    """Return what tours by pressing on the picture."""
    return lambda tour, site: float(
        tour.point(hand(tour.page), site.model.camera, site.simulation.tilt, WITHIN)
    )


def controllers() -> dict[str, tuple[dict[str, Any], Callable[[Any, Any], float]]]:
    from benchmarks.driving.scripted_visitor import Mouse, Pad
    from tests.support.browsers.first_time_user import Keys, Thumb, Touch

    def fingers(page: Page) -> Touch:
        return Touch(page.context.new_cdp_session(page))

    return {
        "keyboard": (WIDE, by_hand(Keys)),
        "gamepad": (WIDE, by_hand(Pad)),
        "stick": (PHONE, by_hand(lambda page: Thumb(page, fingers(page)))),
        "mouse": (WIDE, on_picture(Mouse)),
        "touch": (TABLET, on_picture(fingers)),
    }


def tour(browser: Browser, name: str) -> list[Figure]:
    from benchmarks.driving.scripted_visitor import Tour
    from robots.world.sites import load_plan
    from tests.support.browsers.fake_robot_page import FakeRobotPage
    from tests.support.media.scene_source import SceneSource
    from tests.support.patience import patient

    screen, go = controllers()[name]
    plan, _ = load_plan("office")
    with FakeRobotPage(SceneSource(plan, FPS), start="dock") as site:
        page = browser.new_context(**screen).new_page()
        page.goto(f"{site.url}?go=1")
        page.wait_for_selector(PLAYING, timeout=1000 * patient(30.0))
        person = Tour(page, plan)
        seconds = go(person, site)
        page.context.close()
        drove, methods = site.simulation, {command.method for _, command in site.applied}
    print(
        f"{name}, recorded as {' and '.join(sorted(methods))}: {seconds:.0f} s; was told"
        f" {person.alerts}",
        flush=True,
    )
    return [
        Figure(f"{name}: there and back", seconds, "s"),
        Figure(f"{name}: driven", drove.distance, "m"),
        Figure(f"{name}: contacts", drove.contacts, "", 0.0),
        *(
            [
                Figure(f"{name}: presses", person.presses, ""),
                Figure(f"{name}: turns", person.turns, ""),
            ]
            if person.presses
            else []
        ),
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("controllers", nargs="*", metavar="controller")
    django.setup()
    from tests.support.browsers.visitor import chromium

    names = parser.parse_args().controllers or list(controllers())
    with sync_playwright() as playwright, chromium(playwright) as browser:
        figures = [figure for name in names for figure in tour(browser, name)]
    return keep("drivers", figures)


if __name__ == "__main__":
    sys.exit(main())
