"""A scripted participant: from the link to the completion code, over HTTP and WebSocket alone, by
what the pages offer.

It knows no study. On each page it does what most people do next: it fills in the form, follows the
marked link, drives where the page is one to drive on; until the page shows a code, or, when its
ending says so, until it leaves.
"""

import asyncio
import datetime
import secrets
import time
import urllib.parse
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from experiments.bots import answers
from experiments.bots.browser import Browser, BrowserError, HttpAnswer
from experiments.bots.diary import Diary, PageVisit
from experiments.bots.drive import BotDrive
from experiments.bots.endings import GIVES_UP, Ending
from experiments.bots.page import HtmlForm
from experiments.bots.persona import Persona

MOST_PAGES = 200
SAME_PAGE = 6  # times in a row that a page may come back before it counts as a dead end
ROBOT_AWAY = 20.0  # seconds between two looks at a robot that cannot be reached
MOST_LOOKS = 60
WRONG = 400


class StuckError(Exception):
    """The study leads nowhere; the message says on which page and why."""


@dataclass(eq=False)
class BotParticipant:
    """One bot, and what it does.

    Args:
        site: where the site is.
        link: its own link into the study, as a path.
        persona: who it is.
        ending: how its taking part ends, the first time.
        clock: Unix seconds.
        visits: how often it takes part.
    """

    site: str
    link: str
    persona: Persona
    ending: Ending = Ending.COMPLETES
    clock: Callable[[], float] = time.time
    visits: int = 1
    diary: Diary = field(init=False)
    circumstances: dict[str, str] = field(default_factory=dict)
    drive: BotDrive | None = None
    _left: bool = False
    _visits: int = 1
    _tasks: int = 0

    def __post_init__(self) -> None:
        self.diary = Diary(self.persona.number, str(self.ending))
        self.browser = Browser(self.site, self.persona.agent)
        self._wanted = self.visits + (self.ending == Ending.COMES_AGAIN)

    async def take_part(self) -> Diary:
        """Go through the study and return what there is to tell; whatever the site does wrong
        stands in `stuck`.
        """
        try:
            here = await self._come_in()
            await self._go_through(here)
        except (StuckError, BrowserError) as error:
            self.diary.stuck = str(error)
        return self.diary

    # --- coming in --------------------------------------------------------------------------------

    async def _come_in(self) -> HttpAnswer:
        here = await self._get(self.link)
        sign_up = next((link for link in here.page.links if link.in_main and link.is_primary), None)
        if here.page.next_form() is None and sign_up is not None:
            here = await self._sign_up(
                await self._get(urllib.parse.urljoin(here.url, sign_up.href))
            )
        return here

    async def _sign_up(self, here: HttpAnswer) -> HttpAnswer:
        form = next((form for form in here.page.main_forms() if "password1" in form.fields), None)
        if form is None:
            raise StuckError(f"there is no sign-up form: “{here.page.title}” at {here.path}")
        self.diary.user = (
            f"bot-{self.persona.seed}-{self.persona.number}-{time.time_ns() % 1_000_000_000:09d}"
        )
        secret = secrets.token_urlsafe(18)
        fields = [
            ("username", self.diary.user),
            ("display_name", f"Bot {self.persona.number}"),
            ("password1", secret),
        ]
        after = await self._send(here, form, fields, 0)
        if after.path == here.path:
            raise StuckError(f"signing up was refused: {'; '.join(after.page.errors)}")
        return after

    # --- page by page -----------------------------------------------------------------------------

    async def _go_through(self, here: HttpAnswer) -> None:
        seen: dict[str, int] = {}
        for _ in range(MOST_PAGES):
            if here.status >= WRONG and here.page.next_form() is None:
                raise StuckError(f"{_named(here)} answered with status {here.status}")
            code = here.page.by_id.get("code", "")
            if code:
                self.diary.code, self.diary.done = code, True
                if self._visits >= self._wanted:
                    return
                seen.clear()
            signature = f"{here.path} {' '.join(here.page.headings)} {here.page.text[:400]}"
            seen[signature] = seen.get(signature, 0) + 1
            if seen[signature] > (MOST_LOOKS if self._is_waiting(here) else SAME_PAGE):
                raise StuckError(
                    f"{_named(here)} does not continue: "
                    f"{'; '.join(here.page.errors) or 'no reason given'}"
                )
            following = await self._following(here)
            if following is None:
                return
            here = following
        raise StuckError(f"the study did not end within {MOST_PAGES} pages")

    async def _following(self, here: HttpAnswer) -> HttpAnswer | None:
        """Do what this page asks for, and return the next one; None when the bot has left."""
        began = self.clock()
        entry = PageVisit(
            heading_of(here),
            here.path,
            began,
            words=here.page.words,
            questions=len(_asked(here)),
            drives=_task(here) is not None,
        )
        self.diary.entries.append(entry)
        try:
            return await self._act(here)
        finally:
            entry.seconds = self.clock() - began

    async def _act(self, here: HttpAnswer) -> HttpAnswer | None:
        if "config" in here.page.json and "socket" in here.page.json["config"]:
            return await self._drive(here)
        if here.page.by_id.get("code"):
            return await self._come_again(here)
        leaving = await self._leave(here)
        if leaving is not None or self._left:
            return leaving
        without = here.page.button("without")
        if without is not None and (self._is_waiting(here) or self._gives_up):
            if self._is_waiting(here) and not self._gives_up:
                await asyncio.sleep(ROBOT_AWAY)
                return await self._get(here.url)
            return await self._send(here, *_split(without))
        link = here.page.next_link
        if (
            link is not None
            and self.ending == Ending.LEAVES_READING
            and here.page.next_form() is None
        ):
            self._left = True
            return None
        if link is not None:
            return await self._get(urllib.parse.urljoin(here.url, link.href))
        form = here.page.next_form()
        if form is not None:
            return await self._fill(here, *form)
        raise StuckError(f"{_named(here)} has no link or form to continue with")

    @property
    def _gives_up(self) -> bool:
        """Whether the bot has been at the robot and does not want to drive any more."""
        return self._visits == 1 and self.ending in GIVES_UP and bool(self.diary.legs)

    def _is_waiting(self, here: HttpAnswer) -> bool:
        return here.page.button("without") is not None and here.page.next_link is None

    async def _fill(self, here: HttpAnswer, form: HtmlForm, button: int) -> HttpAnswer:
        now = datetime.datetime.fromtimestamp(self.clock(), datetime.UTC)
        sent = answers.fill(form, self.persona, self.circumstances, now)
        self.diary.answered |= {name: value for name, value in sent if form.id == "survey"}
        return await self._send(here, form, sent, button)

    # --- leaving ----------------------------------------------------------------------------------

    async def _leave(self, here: HttpAnswer) -> HttpAnswer | None:
        refuses = here.page.button("decline") if self.ending == Ending.REFUSES else None
        if refuses is not None:
            self._left = self.diary.done = True
            await self._send(here, *_split(refuses))
            return None
        is_survey = here.page.form("survey") is not None
        if is_survey and self.diary.legs and self.ending == Ending.STOPS_ANSWERING:
            self._left = True
            return None
        if is_survey and self.diary.legs and self.ending == Ending.WITHDRAWS:
            await self._withdraw()
        return None

    async def _withdraw(self) -> None:
        """Through one's own data, where everybody finds it."""
        self._left = True
        data = await self._get("/profile/data/")
        link = next((link for link in data.page.links if "/withdraw/" in link.href), None)
        if link is None:
            raise StuckError("the bot's own data page has no link to withdraw")
        asked = await self._get(urllib.parse.urljoin(data.url, link.href))
        forms = asked.page.main_forms()
        if not forms:
            raise StuckError("the page to withdraw has no button")
        after = await self._send(asked, forms[0], [], 0)
        self.diary.done = after.status < WRONG

    async def _come_again(self, here: HttpAnswer) -> HttpAnswer | None:
        forms = here.page.main_forms()
        if not forms:
            return None
        self._visits += 1
        return await self._send(here, forms[0], [], 0)

    # --- driving ----------------------------------------------------------------------------------

    async def _drive(self, here: HttpAnswer) -> HttpAnswer | None:
        config = here.page.json["config"]
        again = self.ending if self._visits == 1 and not self.diary.legs else Ending.COMPLETES
        is_task = config.get("study", {}).get("kind") == "task"
        number = self._tasks + is_task  # a practice is before the drive that it is for
        self.drive = BotDrive(self.browser, config, self.persona, again, self.clock, number)
        leg = await self.drive.run()
        self._tasks = number
        self.diary.legs.append(leg)
        self.circumstances = leg.circumstances
        self.drive = None
        if self.ending == Ending.CLOSES_PAGE and not leg.outcome:
            self._left = True
            return None
        return await self._get(config.get("study", {}).get("urls", {}).get("step", here.url))

    # --- the browser, which blocks, beside the loop -----------------------------------------------

    async def _get(self, address: str) -> HttpAnswer:
        return await asyncio.to_thread(self.browser.get, address)

    async def _send(
        self, here: HttpAnswer, form: HtmlForm, fields: answers.Sent, button: int
    ) -> HttpAnswer:
        return await asyncio.to_thread(self.browser.send, here, form, fields, button)


def _split(found: tuple[HtmlForm, int]) -> tuple[HtmlForm, answers.Sent, int]:
    return found[0], [], found[1]


def _task(here: HttpAnswer) -> dict[str, Any] | None:
    """Return what a page on which the robot is driven says of its step; None of any other."""
    task: dict[str, Any] | None = here.page.json.get("config", {}).get("study")
    return task


def heading_of(here: HttpAnswer) -> str:
    """Return what a page is called. Where the robot is driven, that is what the study calls the
    step: the headings there are of states that a script shows.
    """
    task = _task(here)
    return task["title"] if task is not None else " · ".join(here.page.headings)


def _named(here: HttpAnswer) -> str:
    """Return a page in words: its heading, and its title, which says the number of the step."""
    return f"the page “{heading_of(here) or here.path}” ({here.page.title})"


def _asked(here: HttpAnswer) -> list[str]:
    form = here.page.form("survey")
    return [name for name in form.fields if not name.endswith("~")] if form is not None else []
