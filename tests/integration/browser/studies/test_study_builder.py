"""A researcher builds a study of two factors in a real Chromium, from empty to published, with the
pages alone.
"""

import pytest
from axe_playwright_python.sync_playwright import Axe
from django.urls import reverse
from playwright.sync_api import Locator, Page, expect

from experiments.models import Study
from robots.models import Robot
from tests.support.media.photographs import keep
from tests.support.people import person
from tests.support.studies.study_site import cabin_with_giraff

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True), pytest.mark.nightly]
SIZES = [(1440, 900), (820, 1180), (390, 844), (844, 390)]
MOST_CLICKS = 70  # ticks and choices among them


class Researcher:
    """Somebody who builds a study and counts what it takes."""

    def __init__(self, page: Page) -> None:
        self.page, self.clicks, self.fields = page, 0, 0

    def press(self, name: str) -> None:
        """Press a button."""
        self.click(self.page.get_by_role("button", name=name, exact=True).first)

    def save(self) -> None:
        """Save, and see that it was."""
        self.press("Save")
        expect(self.page.get_by_text("Saved.")).to_be_visible()

    def follow(self, name: str) -> None:
        """Follow a link."""
        self.click(self.page.get_by_role("link", name=name).first)

    def click(self, what: Locator) -> None:
        """Click, and count it."""
        what.click()
        self.clicks += 1

    def write(self, name: str, text: str) -> None:
        """Write into the field with a name."""
        self.page.locator(f'[name="{name}"]').last.fill(text)
        self.fields += 1

    def choose(self, name: str, label: str) -> None:
        """Choose from a list."""
        self.page.locator(f'[name="{name}"]').select_option(label=label)
        self.clicks += 1

    def tick(self, label: str, group: str = "") -> None:
        """Tick a box, in a group that is opened first."""
        if group:
            self.click(self.page.locator("summary", has_text=group))
        self.page.get_by_label(label, exact=True).check()
        self.clicks += 1


@pytest.fixture
def ines(browser, live_server, client):
    client.force_login(person("ines", is_staff=True, is_superuser=True))
    cabin_with_giraff()
    presence = Robot.objects.get(name="giraff").presence
    presence.factsheet["capabilities"] += ["network_lab"]
    presence.save()
    context = browser.new_context(base_url=live_server.url, reduced_motion="reduce", locale="en")
    session = client.cookies["sessionid"].value
    context.add_cookies([{"name": "sessionid", "value": session, "url": live_server.url}])
    yield Researcher(context.new_page())
    context.close()


def check(page: Page, name: str) -> None:
    """No page is wider than its screen, or has what axe-core finds, at any size."""
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        keep(page, f"builder-{name}-{width}x{height}", whole=True)
        wide = page.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert wide <= 0, f"{name} scrolls sideways at {width}x{height}"
        found = Axe().run(page).response["violations"]
        assert not found, f"{name}: {found[0]['id']} {found[0]['nodes'][0]['html']}"
    page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})


def begin(ines: Researcher) -> None:
    ines.page.goto(reverse("admin:experiments_study_add"))
    ines.write("name", "lag")
    ines.write("called", "Lag and help")
    ines.press("Save")
    ines.follow("Builder")


def design(ines: Researcher) -> None:
    ines.follow("Design")
    ines.press("+ Delay of the video")
    ines.choose("factors.0.design", "within participants: all conditions")
    ines.write("factors.0.levels.0.sets.video_delay", "0")
    ines.write("factors.0.levels.1.sets.video_delay", "0.3")
    ines.press("+ Assistance")
    ines.write("factors.1.title.en", "Help")
    ines.write("factors.1.levels.0.title.en", "None")
    ines.write("factors.1.levels.1.title.en", "Long")
    ines.choose("factors.1.levels.1.sets.assist", "steers around obstacles and through doors")
    ines.save()
    expect(ines.page.get_by_text("4 orders of conditions")).to_be_visible()
    expect(ines.page.get_by_role("link", name="300 ms, Long")).to_be_visible()
    check(ines.page, "design")


def course(ines: Researcher) -> None:
    ines.follow("Courses")
    ines.follow("giraff at cabin")
    for n, (x, y) in enumerate((("3", "1"), ("7", "2")), start=1):
        ines.press("+ Checkpoint")
        ines.write(f"checkpoints.{n}.x", x)
        ines.write(f"checkpoints.{n}.y", y)
    ines.save()


def steps(ines: Researcher) -> None:
    ines.follow("Steps")
    ines.follow("Consent")
    ines.write("text.en", "You will drive a robot, and may stop at any time.")
    ines.save()
    ines.follow("Steps")
    ines.follow("How it works")
    ines.press("+ Page")
    ines.write("leaves.0.text.en", "Drive to each checkpoint, then back to the station.")
    check(ines.page, "instructions")
    ines.save()
    ines.follow("Steps")
    ines.press("+ Post-drive questionnaire")
    ines.write("title.en", "Workload")
    ines.choose("questionnaire", "NASA-TLX: The effort it took, version 1")
    ines.save()
    ines.follow("Steps")
    ines.follow("Thanks")
    ines.write("text.en", "Thank you.")
    ines.save()


def analysis(ines: Researcher) -> None:
    ines.follow("Analyses")
    ines.press("+ Analysis")
    ines.write("title.en", "Delay and help")
    ines.choose("test", "linear mixed model")
    workload = "NASA-TLX: The effort it took"
    ines.tick("Task time (s)", "Metrics of a drive")
    ines.tick(f"overall score of {workload}", workload)
    ines.save()
    for effect in ("Delay of the video", "Help"):
        ines.tick(effect)
    ines.save()
    check(ines.page, "analysis")
    ines.follow("Plan")
    ines.press("+ Hypothesis")
    sentence = "Delay of the video: smaller with 0 ms than with 300 ms"
    ines.choose("hypotheses.0.direction", sentence)
    ines.save()
    expect(ines.page.locator('[name="hypotheses.0.text"]')).to_have_value(
        f"Task time (s), overall score of NASA-TLX: The effort it took – {sentence}."
    )
    check(ines.page, "plan")


def test_two_by_two_study_is_built_and_published_with_the_pages_alone(ines):
    begin(ines)
    design(ines)
    course(ines)
    steps(ines)
    analysis(ines)
    ines.follow("Overview")
    expect(ines.page.get_by_text("Ready to publish")).to_be_visible()
    ines.follow("Publish")
    ines.write("reason", "The pages are tried by a test.")
    ines.press("Publish")
    expect(ines.page.get_by_text("Study published.")).to_be_visible()
    study = Study.objects.get().as_definition()
    assert [step.repeat for step in study.steps if step.kind == "questionnaire"] == [True, True]
    assert study.plan.hypotheses[0].effect == "delay"
    assert study.analyses[0].coding == "sum"
    print(f"{ines.clicks} clicks, {ines.fields} fields")
    assert ines.clicks <= MOST_CLICKS
