"""Coding a replay in a real Chromium: keys and buttons, two tabs, a reload, a lost network."""

import re

import pytest
from django.urls import reverse
from django.utils import timezone
from playwright.sync_api import expect

from experiments.coding import store
from experiments.models import CodingEdit, StudyMember
from tests.support.browsers.visitor import note_problems
from tests.support.media.photographs import keep
from tests.support.people import person
from tests.support.sessions import replays

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True)]
SIZES = {
    "laptop": (1366, 768),
    "tablet": (820, 1180),
    "phone": (390, 844),
    "phone-lying": (844, 390),
}
PAINTED = "() => new Promise((then) => requestAnimationFrame(() => requestAnimationFrame(then)))"
SAVED, KEPT = "All changes are saved.", "kept in this browser"


def code(word: str, name: str, kind: str, **more: object) -> dict[str, object]:
    return {"code": word, "name": name, "kind": kind, **more}


WHOM = {"name": "whom", "values": ["the robot", "a visitor"]}
DESCRIBED = {"description": "Asks anybody, in words or by a gesture.", "modifiers": [WHOM]}
CODES = [
    code("help", "Asks for help", "point", key="h", **DESCRIBED),
    code("lost", "Seems lost", "interval", key="l", group="route"),
    code("sure", "Knows the route", "interval", key="r", group="route"),
    code("talk", "Talks to somebody", "interval", key="t"),
    code("odd", "Something else", "point"),
]
SCHEME = {"blind": True, "codes": CODES}


@pytest.fixture
def session():
    """A session of a minute, in a study with a coding scheme."""
    session = replays.session(replays.cabin_robot(), person("ada"), seconds=60)
    replays.record(session, seconds=60)
    study = replays.study()
    drive = replays.drive(replays.participant(study, session.visitor), session, outcome="completed")
    replays.task_told(drive, 2.0, "checkpoint", number=1)
    store.store_scheme(study, store.scheme_from(SCHEME), timezone.now())
    return session


@pytest.fixture
def coder():
    user = person("carl")
    StudyMember.objects.create(slug="cabin-study", user=user, role="coder")
    return user


@pytest.fixture
def opened(open_page, coder, session):
    """Open pages of one browser, whose requests to addresses like `without` get lost."""
    first, problems = open_page(coder, viewport={"width": 1366, "height": 768}), []

    def open_it(t: float = 0.0, without: str = ""):
        page = first.context.new_page()
        note_problems(page, problems)
        if without:  # before the page is loaded, whose requests might pass otherwise
            page.route(without, lambda route: route.abort())
        page.goto(reverse("code_session", args=[session.pk]) + f"?t={t}")
        expect(page.locator("#coding-codes button")).to_have_count(5)
        page.evaluate(PAINTED)  # Chromium drops earlier keys
        return page

    yield open_it
    assert problems == []


def rows(page):
    return page.locator("#coding-events .coding__row")


def test_keys_add_events_which_are_saved(opened):
    page = opened(10.0)
    page.keyboard.press("l")
    expect(page.get_by_role("button", name="Seems lost").first).to_have_attribute(
        "aria-pressed", "true"
    )
    page.keyboard.press("ArrowRight")
    page.keyboard.press("r")  # of the same group: ends the other
    page.keyboard.press("h")
    expect(rows(page)).to_have_count(3)
    expect(page.locator("#coding-saved")).to_have_text(SAVED)
    page.get_by_label("whom").select_option("a visitor")
    page.get_by_label("Comment").fill("waves")
    page.get_by_label("Comment").press("Enter")
    page.get_by_role("button", name="Starts + 0.1 s").click()
    expect(rows(page).filter(has_text="a visitor · waves")).to_contain_text("0:11.1")
    page.get_by_role("button", name="I am done").click()
    expect(page.locator("#coding-message")).to_contain_text("must end after it begins")
    page.get_by_role("button", name="Knows the route").first.click()
    expect(rows(page).filter(has_text="still on")).to_have_count(0)
    for name, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), name
        keep(page, f"coding-{name}", whole=True)
    page.get_by_role("button", name="I am done").click()
    expect(page.locator("#coding-status")).to_contain_text("You are done.")
    expect(page.get_by_role("button", name="Asks for help").first).to_be_disabled()


def test_events_survive_a_lost_network_and_a_reload(opened):
    page = opened(10.0, without="**/save/*")
    page.keyboard.press("h")
    expect(rows(page)).to_have_count(1)
    expect(page.locator("#coding-saved")).to_contain_text(KEPT)
    page.reload()
    expect(rows(page)).to_have_count(1)
    expect(page.locator("#coding-saved")).to_contain_text(KEPT)
    page.route("**/*.js", lambda route: route.abort())
    page.reload()
    assert page.locator("#coding-saved").inner_text() == "", "no script has run"
    page.unroute("**/*.js")
    page.unroute("**/save/*")
    page.reload()
    expect(page.locator("#coding-saved")).to_have_text(SAVED)
    expect(rows(page)).to_have_count(1)
    assert CodingEdit.objects.count() == 1


def let_through(page, saving):
    """Let the request to save continue, as soon as the page has made it."""
    while not saving:
        page.wait_for_timeout(20)
    saving.pop().continue_()


def test_comment_being_typed_survives_answers_of_the_server(opened):
    one = opened(10.0)
    saving = []
    one.route("**/save/*", lambda route: saving.append(route))
    one.keyboard.press("h")
    one.get_by_label("Comment").fill("waves")
    let_through(one, saving)
    expect(one.locator("#coding-saved")).to_have_text(SAVED)
    two = opened(10.0)
    rows(two).click()
    two.get_by_label("whom").select_option("a visitor")
    expect(rows(one).filter(has_text="a visitor")).to_have_count(1)
    one.keyboard.type(" twice")
    one.keyboard.press("Enter")
    let_through(one, saving)
    expect(one.locator("#coding-saved")).to_have_text(SAVED)
    expect(rows(one)).to_contain_text("a visitor · waves twice")
    expect(one.locator("#coding-message")).to_be_hidden()
    assert CodingEdit.objects.order_by("version").last().comment == "waves twice"


def test_two_tabs_show_the_same_events_and_report_conflicts(opened):
    one, two = opened(10.0), opened(20.0)
    one.keyboard.press("h")
    expect(rows(two)).to_have_count(1)
    two.keyboard.press("h")
    expect(rows(one)).to_have_count(2)
    expect(one.locator("#coding-saved")).to_have_text(SAVED)
    # the first tab changes an event without the knowledge of the second one
    two.route("**/events.json*", lambda route: route.abort())
    one.get_by_label("Comment").fill("first")
    one.get_by_label("Comment").press("Enter")
    expect(rows(one).filter(has_text="first")).to_have_count(1)
    expect(one.locator("#coding-saved")).to_have_text(SAVED)
    rows(two).filter(has_text="0:10.0").click()
    two.get_by_label("Comment").fill("second")
    two.get_by_label("Comment").press("Enter")
    expect(two.locator("#coding-message")).to_contain_text("in another tab")
    expect(rows(two).filter(has_text=re.compile("second"))).to_have_count(1)
    comments = CodingEdit.objects.exclude(comment="").order_by("version")
    assert [edit.comment for edit in comments] == ["first", "second"]
