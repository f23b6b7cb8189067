"""A researcher builds a study of two factors in a real Chromium and publishes it, with the pages
alone.
"""

import pytest
from django.urls import reverse
from playwright.sync_api import Locator, Page, expect

from experiments.models import Study
from robots.models import Robot
from tests.support.browsers.page_sizes import check_at_all_sizes
from tests.support.people import person
from tests.support.studies.study_site import cabin_with_giraff

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True), pytest.mark.nightly]
MOST_CLICKS = 70  # with ticks and choices


class Researcher:
    """Builds a study, and counts clicks and fields."""

    def __init__(self, page: Page) -> None:
        self.page, self.clicks, self.fields = page, 0, 0

    def press(self, name: str) -> None:
        self.click(self.page.get_by_role("button", name=name, exact=True).first)

    def save(self) -> None:
        self.press("Save")
        expect(self.page.get_by_text("Saved.")).to_be_visible()

    def follow(self, name: str) -> None:
        self.click(self.page.get_by_role("link", name=name).first)

    def click(self, what: Locator) -> None:
        what.click()
        self.clicks += 1

    def write(self, name: str, text: str) -> None:
        self.page.locator(f'[name="{name}"]').last.fill(text)
        self.fields += 1

    def choose(self, name: str, label: str) -> None:
        self.page.locator(f'[name="{name}"]').select_option(label=label)
        self.clicks += 1

    def tick(self, label: str, group: str = "") -> None:
        """Tick a box, in a group that is opened first."""
        if group:
            self.click(self.page.locator("summary", has_text=group))
        self.page.get_by_label(label, exact=True).check()
        self.clicks += 1


@pytest.fixture
def ines(open_page):
    user = person("ines", is_staff=True, is_superuser=True)
    cabin_with_giraff()
    presence = Robot.objects.get(name="giraff").presence
    presence.factsheet["capabilities"] += ["network_lab"]
    presence.save()
    return Researcher(open_page(user, reduced_motion="reduce"))


def check(page: Page, name: str) -> None:
    check_at_all_sizes(page, f"builder-{name}", axe_at_each=True)


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
    ines.tick("Task time (s)", "Drive: success and time")
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
