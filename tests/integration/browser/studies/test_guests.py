"""Participants without an account in a real Chromium: the code, the personal link, another device;
and the walk through their pages for researchers.
"""

import functools
import re

import pytest
from django.urls import reverse
from django.utils import timezone
from playwright.sync_api import expect

from experiments.models import Participant
from experiments.participation import links
from tests.support.browsers.page_sizes import SIZES, check_at_all_sizes
from tests.support.browsers.visitor import turn_leaf
from tests.support.media.photographs import keep
from tests.support.people import person
from tests.support.studies import participants as p

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True)]
FRONT = "/studies/exploration/"


@pytest.fixture
def study():
    p.site()
    return p.published(p.of("exploration"), entry="code")


@pytest.fixture
def device(open_page):
    return functools.partial(open_page, viewport={"width": 390, "height": 844})


def check(page, name: str) -> None:
    check_at_all_sizes(page, f"guests-{name}")


def test_participant_with_a_code_continues_on_another_device(study, device):
    phone, laptop = device(), device()
    phone.goto(FRONT)
    check(phone, "front")
    phone.get_by_role("button", name="Take part").click()
    expect(phone.get_by_text("Write down this code")).to_be_visible()
    code = phone.locator("#entry-code").inner_text()
    assert re.fullmatch("[2-9A-Z]{4}-[2-9A-Z]{4}", code)
    check(phone, "code")
    phone.get_by_role("link", name="Continue").click()
    expect(phone).to_have_title(re.compile("^Step 1 of 6 · Explore an office"))
    check(phone, "consent")
    phone.get_by_label("Your age in years").fill("31")
    phone.get_by_label("I have read this and want to take part.").check()
    phone.get_by_role("button", name="Agree and continue").click()
    expect(phone).to_have_title(re.compile("^Step 2 of 6 · Explore an office"))
    check(phone, "questions")
    laptop.goto(FRONT)
    laptop.get_by_label("Your code").fill(code.lower())
    laptop.get_by_role("button", name="Continue with the code").click()
    expect(laptop).to_have_title(re.compile("^Step 2 of 6 · Explore an office"))
    laptop.goto(reverse("own_data"))
    check(laptop, "own-data")
    laptop.goto(reverse("study_code"))
    laptop.get_by_label("Your code").fill("2222-2222")
    laptop.get_by_role("button", name="Continue").click()
    expect(laptop.get_by_text("This code isn't known.")).to_be_visible()
    check(laptop, "wrong-code")
    assert Participant.objects.count() == 1


@pytest.mark.nightly
def test_personal_link_opens_the_study_on_every_device(study, device):
    _row, token = links.make(study, now=timezone.now())
    phone, laptop = device(), device()
    phone.goto(reverse("study_link", args=[token]))
    check(phone, "link")
    phone.get_by_role("button", name="Take part").click()
    expect(phone).to_have_title(re.compile("^Step 1 of 6"))
    laptop.goto(reverse("study_link", args=[token]))
    check(laptop, "link-again")
    laptop.get_by_role("button", name="Continue where you left off").click()
    expect(laptop).to_have_title(re.compile("^Step 1 of 6"))
    laptop.goto(FRONT)
    check(laptop, "under-way")
    assert Participant.objects.count() == 1


@pytest.mark.nightly
def test_researcher_walks_through_every_step_in_a_phone_wide_frame(study, device):
    page = device(person("boss", is_staff=True, is_superuser=True))
    page.goto(reverse("admin:experiments_study_walk_through", args=[study.pk]))
    frame = page.frame_locator("iframe")
    expect(frame.get_by_text("the site saves nothing")).to_be_visible()
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        keep(page, f"walk-through-{size}", whole=True)
    frame.get_by_role("button", name="Agree and continue").click()
    expect(frame.get_by_role("heading", name="About you")).to_be_visible()
    frame.get_by_role("button", name="Send the answers").click()
    for _leaf in range(3):
        turn_leaf(frame)
    frame.get_by_role("button", name="I have read this, continue").click()
    frame.get_by_role("button", name="Continue", exact=True).click()
    expect(frame.get_by_text("Step 5 of 6")).to_be_visible()
    while frame.get_by_role("link", name="Next").is_visible():
        turn_leaf(frame)
    frame.get_by_role("button", name="Send the answers").click()
    expect(frame.get_by_text("Your completion code")).to_be_visible()
    page.get_by_role("link", name="Spanish", exact=True).click()
    expect(frame.get_by_role("heading", name="Consentimiento")).to_be_visible()
    assert not Participant.objects.exists()
