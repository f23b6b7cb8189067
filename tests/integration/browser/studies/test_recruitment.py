"""Participants whom a recruitment site sent, in a real Chromium on a phone and a desktop: they
arrive with an id, and return with the code of how it ended.
"""

import pytest
from axe_playwright_python.sync_playwright import Axe
from django.utils import timezone
from playwright.sync_api import expect

from experiments.models import Participant
from experiments.participation import completion
from surveys.models import Response
from tests.support.media.photographs import keep
from tests.support.studies import participants as p

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True)]
FRONT = "/studies/exploration/"
PHONE = "Mozilla/5.0 (Linux; Android 14) AppleWebKit/537.36 Chrome/120.0 Mobile Safari/537.36"
SIZES = {
    "desktop": (1440, 900),
    "tablet": (820, 1180),
    "phone": (390, 844),
    "landscape": (844, 390),
}


@pytest.fixture
def robot():
    return p.site()


@pytest.fixture
def arrive(browser, live_server):
    """Open a study's link in a browser of its own; no page may have raised."""
    made = []

    def make(size: str, identifier: str, **options):
        width, height = SIZES[size]
        page = browser.new_context(
            base_url=live_server.url,
            locale="en",
            viewport={"width": width, "height": height},
            **options,
        ).new_page()
        page.problems = []
        page.on("pageerror", lambda error: page.problems.append(str(error)))
        page.context.route("**/return/", go_no_further)
        page.goto(f"{FRONT}?PROLIFIC_PID={identifier}&STUDY_ID=s&SESSION_ID=session-{identifier}")
        made.append(page)
        return page

    yield make
    for page in made:
        page.context.close()
    assert [problem for page in made for problem in page.problems] == []


def go_no_further(route) -> None:
    """Say where the site redirects to, instead of going there."""
    answer = route.fetch(max_redirects=0)
    route.fulfill(body=f"Redirected to {answer.headers['location']}")


def check(page, name: str) -> None:
    """Keep the page at every size; nothing is cut off, and a screen reader finds its way."""
    before = page.viewport_size
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate("document.documentElement.scrollWidth") <= width, f"{name} {size}"
        keep(page, f"recruitment-{name}-{size}", whole=True)
    page.set_viewport_size(before)
    assert Axe().run(page).response["violations"] == [], name


def agree(page, age: str = "31") -> None:
    page.get_by_label("Your age in years").fill(age)
    page.get_by_label("I have read this and want to take part.").check()
    page.get_by_role("button", name="Agree and continue").click()


def skip_questions(page) -> None:
    """Finish the questionnaire of the step as if it had been answered."""
    expect(page.get_by_role("button", name="Send the answers")).to_be_visible()
    Response.objects.filter(finished_at=None).update(finished_at=timezone.now())
    page.goto(f"{FRONT}step/")


def read_on(page) -> None:
    while page.get_by_role("link", name="Next").is_visible():
        page.get_by_role("link", name="Next").click()
    page.get_by_role("button", name="I have read this, continue").click()


@pytest.mark.parametrize("size", ["phone", pytest.param("desktop", marks=pytest.mark.nightly)])
def test_a_recruit_goes_from_the_link_back_to_the_site_with_the_code(robot, arrive, size):
    study = p.published(p.of("exploration"), entry="code")
    page = arrive(size, "5f0c")
    check(page, "front")
    page.get_by_role("button", name="Take part").click()
    agree(page)
    skip_questions(page)
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
    page.get_by_role("link", name="Return to Prolific").click()
    code = completion.code(study, "done")
    expect(page.get_by_text(f"complete?cc={code}")).to_be_visible()


@pytest.mark.parametrize("size", ["phone", pytest.param("desktop", marks=pytest.mark.nightly)])
def test_a_recruit_who_leaves_the_robot_unmoved_reads_so_and_returns(robot, arrive, size):
    study = p.published(p.of("exploration"), entry="code")
    page = arrive(size, "5f0c")
    page.get_by_role("button", name="Take part").click()
    agree(page)
    skip_questions(page)
    read_on(page)
    participant = p.assign(Participant.objects.get(), "giraff_open")
    p.drive_of(robot, participant, outcome="cancelled", moved=False)
    page.goto(f"{FRONT}step/")
    page.get_by_role("button", name="Continue without driving").click()
    skip_questions(page)
    expect(page.get_by_text("You left before the robot moved")).to_be_visible()
    check(page, "left")
    page.get_by_role("link", name="Return to Prolific").click()
    code = completion.code(study, "left")
    expect(page.get_by_text(f"complete?cc={code}")).to_be_visible()


@pytest.mark.nightly
@pytest.mark.parametrize("size", ["phone", "desktop"])
def test_a_recruit_whose_time_ran_out_returns_with_the_code_for_that(robot, arrive, size):
    study = p.published(p.of("exploration"), entry="code")
    page = arrive(size, "5f0c")
    page.get_by_role("button", name="Take part").click()
    agree(page)
    skip_questions(page)
    read_on(page)
    participant = p.assign(Participant.objects.get(), "giraff_open")
    p.drive_of(robot, participant, outcome="timed_out", moved=True)
    page.goto(f"{FRONT}step/")
    skip_questions(page)
    expect(page.get_by_text("Your driving time ran out")).to_be_visible()
    check(page, "timed-out")
    page.get_by_role("link", name="Return to Prolific").click()
    code = completion.code(study, "timed_out")
    expect(page.get_by_text(f"complete?cc={code}")).to_be_visible()


@pytest.mark.nightly
@pytest.mark.parametrize("size", ["phone", "desktop"])
def test_an_answer_screens_a_recruit_out_who_returns_and_stays_out(robot, arrive, size):
    rule = {"questionnaire": "ict", "item": "videogames", "at_least": 4}
    definition = p.of("exploration", screening=[rule], turned_away_code=True)
    study = p.published(definition, entry="code")
    page = arrive(size, "5f0c")
    page.get_by_role("button", name="Take part").click()
    agree(page)
    skip_questions(page)
    check(page, "screened-out")
    page.get_by_role("link", name="Return to Prolific").click()
    code = completion.code(study, "screened_out")
    expect(page.get_by_text(f"complete?cc={code}")).to_be_visible()
    again = arrive(size, "5f0c")
    expect(again.get_by_role("button", name="Take part")).to_have_count(0)
    check(again, "screened-out-again")


@pytest.mark.nightly
def test_a_minor_names_a_guardian_and_a_phone_without_a_computer_is_turned_away(robot, arrive):
    p.published(p.of("exploration", devices=["computer"], turned_away_code=True), entry="code")
    page = arrive("desktop", "minor")
    page.get_by_role("button", name="Take part").click()
    agree(page, "15")
    check(page, "guardian")
    page.get_by_label("Name of the parent or guardian who also agrees").fill("Grandma")
    page.get_by_role("button", name="Agree and continue").click()
    expect(page.get_by_role("button", name="Send the answers")).to_be_visible()
    phone = arrive(
        "phone",
        "phone",
        user_agent=PHONE,
    )
    check(phone, "device")
    phone.get_by_role("button", name="I don't have one").click()
    check(phone, "turned-away")
    phone.get_by_role("link", name="Return to Prolific").click()
    expect(phone.get_by_text("complete?cc=")).to_be_visible()


@pytest.mark.nightly
def test_a_participant_books_a_time_on_a_phone(robot, arrive):
    p.published(p.of("exploration", appointments={"minutes": 30}), entry="code")
    page = arrive("phone", "5f0c")
    page.get_by_role("button", name="Take part").click()
    agree(page)
    skip_questions(page)
    read_on(page)
    check(page, "appointment-needed")
    page.get_by_role("link", name="Choose a time").click()
    check(page, "appointment")
    page.get_by_label("E-mail address for a reminder").fill("ada@example.org")
    page.locator("button[name=at]").first.click()
    expect(page.get_by_text("Your appointment is on")).to_be_visible()
    check(page, "appointment-made")
