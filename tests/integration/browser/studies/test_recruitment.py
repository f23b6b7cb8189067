"""Participants from a recruitment site, in a real Chromium on a phone and a desktop: they arrive
with an id, and return with a completion code.
"""

import pytest
from django.utils import timezone
from playwright.sync_api import expect

from experiments.models import Participant
from experiments.participation import completion
from surveys.models import Response
from tests.support.browsers.page_sizes import SIZES, check_at_all_sizes
from tests.support.studies import participants as p

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True)]
FRONT = "/studies/exploration/"
PHONE = "Mozilla/5.0 (Linux; Android 14) AppleWebKit/537.36 Chrome/120.0 Mobile Safari/537.36"


@pytest.fixture
def robot():
    return p.site()


@pytest.fixture
def arrive(open_page):
    """Open a study's link in a browser of its own."""

    def make(size: str, identifier: str, **options):
        width, height = SIZES[size]
        page = open_page(viewport={"width": width, "height": height}, **options)
        page.context.route("**/return/", go_no_further)
        page.goto(f"{FRONT}?PROLIFIC_PID={identifier}&STUDY_ID=s&SESSION_ID=session-{identifier}")
        return page

    return make


def go_no_further(route) -> None:
    """Show the address of a redirection instead of following it."""
    answer = route.fetch(max_redirects=0)
    route.fulfill(body=f"Redirected to {answer.headers['location']}")


def check(page, name: str) -> None:
    check_at_all_sizes(page, f"recruitment-{name}")


def agree(page, age: str = "31") -> None:
    page.get_by_label("Your age in years").fill(age)
    page.get_by_label("I have read this and want to take part.").check()
    page.get_by_role("button", name="Agree and continue").click()


def skip_questions(page) -> None:
    """Mark the questionnaire of the step as answered."""
    expect(page.get_by_role("button", name="Send the answers")).to_be_visible()
    Response.objects.filter(finished_at=None).update(finished_at=timezone.now())
    page.goto(f"{FRONT}step/")


def take_part(page) -> None:
    page.get_by_role("button", name="Take part").click()
    agree(page)
    skip_questions(page)


def returns_with(page, code: str) -> None:
    page.get_by_role("link", name="Return to Prolific").click()
    expect(page.get_by_text(f"complete?cc={code}")).to_be_visible()


def read_on(page) -> None:
    while page.get_by_role("link", name="Next").is_visible():
        page.get_by_role("link", name="Next").click()
    page.get_by_role("button", name="I have read this, continue").click()


@pytest.mark.parametrize("size", ["phone", pytest.param("desktop", marks=pytest.mark.nightly)])
def test_recruit_returns_to_the_site_with_the_code(robot, arrive, size):
    study = p.published(p.of("exploration"), entry="code")
    page = arrive(size, "5f0c")
    check(page, "front")
    take_part(page)
    other = arrive("phone" if size == "desktop" else "desktop", "5f0c")
    check(other, "recognized")
    other.get_by_role("button", name="Continue where you left off").click()
    read_on(other)
    expect(other.get_by_role("link", name="Go to the robot")).to_be_visible()
    participant = p.assign(Participant.objects.get(), "giraff_open")
    p.drive_of(robot, participant, outcome="completed", moved=True)
    page.goto(f"{FRONT}step/")
    skip_questions(page)
    check(page, "end")
    returns_with(page, completion.code(study, "done"))


ENDS = [
    ("cancelled", "left", "You left before you moved the robot"),
    ("timed_out", "timed_out", "Your driving time ran out"),
]


@pytest.mark.parametrize("size", ["phone", pytest.param("desktop", marks=pytest.mark.nightly)])
@pytest.mark.parametrize(("outcome", "kind", "sentence"), ENDS, ids=["never moved", "timed out"])
def test_recruit_whose_drive_ended_early_reads_why_and_returns_with_its_code(
    robot, arrive, size, outcome, kind, sentence
):
    study = p.published(p.of("exploration"), entry="code")
    page = arrive(size, "5f0c")
    take_part(page)
    read_on(page)
    participant = p.assign(Participant.objects.get(), "giraff_open")
    p.drive_of(robot, participant, outcome=outcome, moved=outcome == "timed_out")
    page.goto(f"{FRONT}step/")
    if outcome == "cancelled":
        page.get_by_role("button", name="Continue without driving").click()
    skip_questions(page)
    expect(page.get_by_text(sentence)).to_be_visible()
    check(page, kind.replace("_", "-"))
    returns_with(page, completion.code(study, kind))


@pytest.mark.nightly
@pytest.mark.parametrize("size", ["phone", "desktop"])
def test_recruit_screened_out_by_an_answer_returns_and_stays_out(robot, arrive, size):
    rule = {"questionnaire": "ict", "item": "videogames", "at_least": 4}
    definition = p.of("exploration", screening=[rule], turned_away_code=True)
    study = p.published(definition, entry="code")
    page = arrive(size, "5f0c")
    take_part(page)
    check(page, "screened-out")
    returns_with(page, completion.code(study, "screened_out"))
    again = arrive(size, "5f0c")
    expect(again.get_by_role("button", name="Take part")).to_have_count(0)
    check(again, "screened-out-again")


@pytest.mark.nightly
def test_minor_names_a_guardian_and_a_phone_user_is_turned_away(robot, arrive):
    p.published(p.of("exploration", devices=["computer"], turned_away_code=True), entry="code")
    page = arrive("desktop", "minor")
    page.get_by_role("button", name="Take part").click()
    agree(page, "15")
    check(page, "guardian")
    page.get_by_label("Name of the parent or guardian who also agrees").fill("Grandma")
    page.get_by_role("button", name="Agree and continue").click()
    expect(page.get_by_role("button", name="Send the answers")).to_be_visible()
    phone = arrive("phone", "phone", user_agent=PHONE)
    check(phone, "device")
    phone.get_by_role("button", name="I don't have one").click()
    check(phone, "turned-away")
    phone.get_by_role("link", name="Return to Prolific").click()
    expect(phone.get_by_text("complete?cc=")).to_be_visible()


@pytest.mark.nightly
def test_participant_books_a_time_on_a_phone(robot, arrive):
    p.published(p.of("exploration", appointments={"minutes": 30}), entry="code")
    page = arrive("phone", "5f0c")
    take_part(page)
    read_on(page)
    check(page, "appointment-needed")
    page.get_by_role("link", name="Choose a time").click()
    check(page, "appointment")
    page.get_by_label("E-mail address for a reminder").fill("ada@example.org")
    page.locator("button[name=at]").first.click()
    expect(page.get_by_text("Your appointment is on")).to_be_visible()
    check(page, "appointment-made")
