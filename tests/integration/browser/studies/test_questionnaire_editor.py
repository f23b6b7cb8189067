"""A questionnaire is written in the administration with a real Chromium, and used in a study."""

import pytest
from django.urls import reverse
from django.utils import timezone
from playwright.sync_api import Page, expect

from experiments import publishing
from experiments.models import Study
from tests.support.browsers.page_sizes import check_at_all_sizes
from tests.support.people import person

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True), pytest.mark.nightly]


@pytest.fixture
def page(open_page):
    return open_page(person("ines", is_staff=True, is_superuser=True), reduced_motion="reduce")


def check(page: Page, name: str) -> None:
    check_at_all_sizes(page, f"questionnaire-{name}", axe_at_each=True)


def fill(page: Page, group: str, label: str, *texts: str) -> None:
    """Write a text in both languages, in a part of the form or at its top."""
    where = page.get_by_role("group", name=group, exact=True) if group else page.locator("#part")
    for language, text in zip(("English", "Spanish"), texts, strict=True):
        where.get_by_label(f"{label} ({language})", exact=True).first.fill(text)


def add(page: Page, kind: str) -> None:
    page.locator("summary", has_text="+ Question").click()
    page.get_by_role("button", name=f"+ {kind}", exact=True).click()


def test_questionnaire_is_written_previewed_and_used_in_a_study(page):
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
