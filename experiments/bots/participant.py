"""A scripted participant: from the link to the completion code, over HTTP and WebSocket alone.

It knows no study. On each page it does what most people do next: it fills in the form, follows the
marked link, or drives; until the page shows a code or the bot leaves, as its ending demands.
"""

import asyncio
import datetime
import secrets
import time
import urllib.parse
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from experiments.bots import answers
from experiments.bots.browser import Browser, BrowserError, HttpAnswer
from experiments.bots.diary import Diary, PageVisit
from experiments.bots.drive import BotDrive
from experiments.bots.endings import GIVES_UP, Ending
from experiments.bots.page import Button, HtmlForm
from experiments.bots.persona import Persona

MAX_PAGES = 200
SAME_PAGE = 6  # times that a page may return before it counts as a dead end
POLL_SECONDS = 20.0  # between two looks at a robot that cannot be reached
MAX_POLLS = 60
BAD_REQUEST = 400  # the lowest status of an error


class StuckError(Exception):
    """The study leads nowhere; the message says on which page and why."""


@dataclass(eq=False)
class BotParticipant:
    """One bot on a site. `link` is its own path into the study; it takes part `visits` times, the
    first time with this ending. `clock` gives Unix seconds.
    """

    site: str
    link: str
    persona: Persona
    ending: Ending = Ending.COMPLETES
    clock: Callable[[], float] = time.time
    visits: int = 1
    circumstances: dict[str, str] = field(default_factory=dict)  # of the last drive
    drive: BotDrive | None = None  # in progress
    _participation: int = 1  # counted from 1
    _tasks: int = 0  # drives so far, without practices

    def __post_init__(self) -> None:
        self.diary = Diary(self.persona.number, str(self.ending))
        self.browser = Browser(self.site, self.persona.agent)
        self._wanted = self.visits + (self.ending == Ending.COMES_AGAIN)

    async def take_part(self) -> Diary:
        """Go through the study and return the log; an error of the site is in `stuck`."""
        try:
            here = await self._get(self.link)
            sign_up = here.page.next_link
            if here.page.next_form() is None and sign_up is not None:
                here = await self._sign_up(await self._follow(here, sign_up))
            await self._go_through(here)
        except (StuckError, BrowserError) as error:
            self.diary.stuck = str(error)
        return self.diary

    async def _sign_up(self, here: HttpAnswer) -> HttpAnswer:
        form = next((form for form in here.page.forms if "password1" in form.fields), None)
        if form is None:
            raise StuckError(f"there is no sign-up form: “{here.page.title}” at {here.path}")
        unique = f"{time.time_ns() % 1_000_000_000:09d}"
        self.diary.user = f"bot-{self.persona.seed}-{self.persona.number}-{unique}"
        fields = {"username": self.diary.user, "display_name": f"Bot {self.persona.number}"}
        fields["password1"] = secrets.token_urlsafe(18)
        after = await self._send(here, form, fields=fields.items())
        if after.path == here.path:
            raise StuckError(f"signing up was refused: {'; '.join(after.page.errors)}")
        return after

    # --- page by page -----------------------------------------------------------------------------

    async def _go_through(self, here: HttpAnswer) -> None:
        seen: Counter[str] = Counter()
        for _ in range(MAX_PAGES):
            page = here.page
            if here.status >= BAD_REQUEST and page.next_form() is None:
                raise StuckError(f"{_named(here)} answered with status {here.status}")
            if code := page.text_of("code"):
                self.diary.code, self.diary.done = code, True
                if self._participation >= self._wanted:
                    return
                seen.clear()
            signature = f"{here.path} {' '.join(page.headings)} {page.text[:400]}"
            seen[signature] += 1
            if seen[signature] > (MAX_POLLS if _is_waiting(here) else SAME_PAGE):
                reason = "; ".join(page.errors) or "no reason given"
                raise StuckError(f"{_named(here)} does not continue: {reason}")
            following = await self._take_step(here)
            if following is None:
                return
            here = following
        raise StuckError(f"the study did not end within {MAX_PAGES} pages")

    async def _take_step(self, here: HttpAnswer) -> HttpAnswer | None:
        """Do what this page asks for, and return the next one; None when the bot has left."""
        began, survey = self.clock(), here.page.form("survey")
        entry = PageVisit(heading_of(here), here.path, began, drives=_task(here) is not None)
        entry.words = len(here.page.text.split())
        entry.questions = sum(not name.endswith("~") for name in (survey.fields if survey else ()))
        self.diary.entries.append(entry)
        try:
            return await self._act(here)
        finally:
            entry.seconds = self.clock() - began

    async def _act(self, here: HttpAnswer) -> HttpAnswer | None:
        page = here.page
        if "socket" in page.json.get("config", {}):
            return await self._drive(here)
        if page.text_of("code"):
            self._participation += 1
            return await self._send(here, page.forms[0]) if page.forms else None
        if await self._leaves(here):
            return None
        # the bot was at the robot, and does not want to drive any more
        gives_up = self._participation == 1 and self.ending in GIVES_UP and bool(self.diary.legs)
        without = page.button("without")
        if without is not None and gives_up:
            return await self._send(here, *without)
        if _is_waiting(here):
            await asyncio.sleep(POLL_SECONDS)
            return await self._get(here.url)
        link, form = page.next_link, page.next_form()
        if link is not None:
            leaves = form is None and self.ending == Ending.LEAVES_READING
            return None if leaves else await self._follow(here, link)
        if form is None:
            raise StuckError(f"{_named(here)} has no link or form to continue with")
        return await self._fill(here, *form)

    async def _fill(self, here: HttpAnswer, form: HtmlForm, button: Button) -> HttpAnswer:
        now = datetime.datetime.fromtimestamp(self.clock(), datetime.UTC)
        sent = answers.fill(form, self.persona, self.circumstances, now)
        if form.id == "survey":
            self.diary.answered |= dict(sent)
        return await self._send(here, form, button, sent)

    async def _leaves(self, here: HttpAnswer) -> bool:
        """Leave on this page if the ending says so; tell whether it did."""
        refusal = here.page.button("decline") if self.ending == Ending.REFUSES else None
        if refusal is not None:
            await self._send(here, *refusal)
            self.diary.done = True
            return True
        if here.page.form("survey") is None or not self.diary.legs:
            return False
        if self.ending == Ending.WITHDRAWS:
            await self._withdraw()
        return self.ending in {Ending.STOPS_ANSWERING, Ending.WITHDRAWS}

    async def _withdraw(self) -> None:
        """Withdraw by the link on the page of the bot's own data."""
        data = await self._get("/profile/data/")
        link = next((link for link in data.page.links if "/withdraw/" in link), None)
        if link is None:
            raise StuckError("the bot's own data page has no link to withdraw")
        asked = await self._follow(data, link)
        if not asked.page.forms:
            raise StuckError("the page to withdraw has no button")
        after = await self._send(asked, asked.page.forms[0])
        self.diary.done = after.status < BAD_REQUEST

    async def _drive(self, here: HttpAnswer) -> HttpAnswer | None:
        config = here.page.json["config"]
        study = config.get("study", {})
        is_first = self._participation == 1 and not self.diary.legs
        ending = self.ending if is_first else Ending.COMPLETES
        # a practice has the number of the drive that follows it
        number = self._tasks + (study.get("kind") == "task")
        self.drive = BotDrive(self.browser, config, self.persona, ending, self.clock, number)
        leg = await self.drive.run()
        self.drive, self._tasks, self.circumstances = None, number, leg.circumstances
        self.diary.legs.append(leg)
        if self.ending == Ending.CLOSES_PAGE and not leg.outcome:
            return None
        return await self._get(study.get("urls", {}).get("step", here.url))

    # --- the browser, which blocks, in a thread ---------------------------------------------------

    async def _get(self, address: str) -> HttpAnswer:
        return await asyncio.to_thread(self.browser.open, address)

    async def _follow(self, here: HttpAnswer, href: str) -> HttpAnswer:
        return await self._get(urllib.parse.urljoin(here.url, href))

    async def _send(
        self,
        here: HttpAnswer,
        form: HtmlForm,
        button: Button | None = None,
        fields: Iterable[tuple[str, str]] = (),
    ) -> HttpAnswer:
        return await asyncio.to_thread(self.browser.send, here, form, fields, button)


def _is_waiting(here: HttpAnswer) -> bool:
    return here.page.button("without") is not None and here.page.next_link is None


def _task(here: HttpAnswer) -> Any:
    """Return the study's part of a drive page's configuration; None for other pages."""
    return here.page.json.get("config", {}).get("study")


def heading_of(here: HttpAnswer) -> str:
    """Return the title of a page. Where the robot is driven, that is the step's title: the headings
    there are of states that a script shows.
    """
    task = _task(here)
    return str(task["title"]) if task is not None else " · ".join(here.page.headings)


def _named(here: HttpAnswer) -> str:
    """Return a page in words: its heading, and its title, which has the number of the step."""
    return f"the page “{heading_of(here) or here.path}” ({here.page.title})"
