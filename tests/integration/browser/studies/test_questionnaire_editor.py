"""A person writes a questionnaire in the administration of a real Chromium, from empty to a step of
a study.
"""

import pytest
from axe_playwright_python.sync_playwright import Axe
from django.urls import reverse
from django.utils import timezone
from playwright.sync_api import Page, expect

from experiments import publishing
from experiments.models import Study
from tests.support.media.photographs import keep
from tests.support.people import person

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True), pytest.mark.nightly]
SIZES = [(1366, 768), (820, 1180), (390, 844), (844, 390)]


@pytest.fixture
def page(browser, live_server, client):
    client.force_login(person("ines", is_staff=True, is_superuser=True))
    still = {"reduced_motion": "reduce", "locale": "en"}
    context = browser.new_context(base_url=live_server.url, **still)
    session = client.cookies["sessionid"].value
    context.add_cookies([{"name": "sessionid", "value": session, "url": live_server.url}])
    yield context.new_page()
    context.close()


def check(page: Page, name: str) -> None:
    """No page is wider than its screen, or has what axe-core finds, at any size."""
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        keep(page, f"questionnaire-{name}-{width}x{height}", whole=True)
        wide = page.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert wide <= 0, f"{name} scrolls sideways at {width}x{height}"
        found = Axe().run(page).response["violations"]
        assert not found, (
            f"{name} {width}x{height}: {found[0]['id']} {found[0]['nodes'][0]['html']}"
        )
    page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})


def fill(page: Page, group: str, label: str, *texts: str) -> None:
    """Write a text in both languages, in a part of the form or at its top."""
    where = page.get_by_role("group", name=group, exact=True) if group else page.locator("#part")
    for language, text in zip(("English", "Spanish"), texts, strict=True):
        where.get_by_label(f"{label} ({language})", exact=True).first.fill(text)


def add(page: Page, kind: str) -> None:
    page.locator("summary", has_text="+ Question").click()
    page.get_by_role("button", name=f"+ {kind}", exact=True).click()


def test_a_questionnaire_is_written_previewed_and_used_in_a_study(page):
    page.goto(reverse("admin:surveys_questionnaire_changelist"))
    page.get_by_role("link", name="Write a questionnaire").click()
    page.get_by_label("Title").fill("Doors and you")
    page.get_by_label("English").check()
    page.get_by_label("Spanish").check()
    check(page, "begun")
    page.get_by_role("button", name="Begin").click()

    page.get_by_role("link", name="No text yet").click()
    fill(page, "", "Text", "Why did you stop?", "¿Por qué paraste?")
    page.get_by_role("button", name="Save and go back").click()

    add(page, "Several statements on one scale")
    fill(page, "", "Text", "Driving was", "Conducir fue")
    fill(page, "Statement 1", "Text", "easy.", "fácil.")
    fill(page, "Statement 2", "Text", "fun.", "divertido.")
    expect(page.get_by_label("Scale", exact=True)).to_have_value("agreement_5")
    check(page, "grid")
    page.get_by_role("button", name="Save", exact=True).click()
    expect(page.get_by_text("Saved.")).to_be_visible()
    page.get_by_role("link", name="Back to the questionnaire").click()

    add(page, "Single choice")
    fill(page, "", "Text", "Would you drive again?", "¿Conducirías otra vez?")
    fill(page, "Option 1", "Label", "Yes", "Sí")
    fill(page, "Option 2", "Label", "No", "No")
    page.get_by_label("An answer is required").check()
    page.get_by_label("Yes", exact=True).last.check()  # shown in some cases only
    page.get_by_label("Earlier question").select_option("Driving was · easy.")
    check(page, "choice")
    page.get_by_role("button", name="Save", exact=True).click()
    page.get_by_label("Agree", exact=True).check()
    page.get_by_role("button", name="Save and go back").click()
    expect(page.get_by_text("Complete: a study can use it.")).to_be_visible()
    check(page, "overview")

    with page.context.expect_page() as opened:
        page.get_by_role("link", name="Preview Page 1").click()
    preview = opened.value
    preview.get_by_role("link", name="Spanish").click()
    expect(preview.get_by_role("group", name="¿Conducirías otra vez?")).to_be_visible()
    expect(preview.get_by_label("Muy en desacuerdo").first).to_be_attached()

    study = publishing.begin_empty("mine", "My study", ["en"], timezone.now())
    page.goto(reverse("admin:experiments_study_part", args=[study.pk, "steps", 4]))
    page.get_by_label("Questionnaire", exact=True).select_option("Doors and you, version 1")
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_text("Saved.")).to_be_visible()
    assert Study.objects.get().as_definition().steps[4].questionnaire == "doors-and-you"
