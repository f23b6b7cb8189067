"""A whole study from the link to the thanks: newcomers in Chromium, a simulated robot, a broker.

A short course at the size of a desktop; the phone and the paper's whole course, with either door
closed, run in the soak test.
"""

import json
import re

import msgspec
import pytest
from playwright.sync_api import Page, expect

from experiments.definition.shipped import shipped
from tests.support.browsers.first_time_user import FirstTimeUser, Keys, Thumb, Touch
from tests.support.browsers.visitor import turn_leaf
from tests.support.sessions.site import PRESENCE, Site, running_site, wait_for

pytestmark = pytest.mark.browser
SIZES = {
    "desktop": {"viewport": {"width": 1280, "height": 800}},
    "phone": {
        "viewport": {"width": 390, "height": 844},
        "has_touch": True,
        "is_mobile": True,
        "device_scale_factor": 2,
    },
}
CONDITIONS = ("giraff_open", "giraff_lab_closed", "giraff_lounge_closed")
SHORT = [("desktop", "giraff_lounge_closed", True)]
ENDURANCE = [
    ("phone", "giraff_open", True),
    *((size, condition, False) for size in SIZES for condition in CONDITIONS),
]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    with running_site(tmp_path_factory.mktemp("study")) as site:
        yield site


@pytest.fixture(scope="module")
def giraff(site):
    robot = site.start_robot("giraff", "--start", "dock", "--seed", "3")
    stored = f"SELECT 1 {PRESENCE} WHERE name = 'giraff' AND factsheet IS NOT NULL"
    wait_for(lambda: site.rows(stored), 20, "the factsheet")
    return robot


def publish(site: Site, condition: str, *, short: bool) -> str:
    """Publish the paper's study with one condition; return its slug. `short` omits checkpoints."""
    study = msgspec.to_builtins(shipped()["exploration"])
    course = next(one for one in study["courses"] if one["robot"] == "giraff")
    if short:
        home, *_, mirror = course["checkpoints"]
        title = {"en": "In the laboratory", "es": "En el laboratorio"}
        near = home | {"number": 1, "x": 2.6, "y": 5.6, "title": title}
        course |= {
            "checkpoints": [home, near, mirror | {"number": 2}],
            "path": [],
            "doors": [],
            "photo": course["photo"] | {"checkpoint": 2},
        }
    slug = f"{condition.replace('_', '-')}{'-short' if short else ''}"
    conditions = [one for one in study["conditions"] if one["key"] == condition]
    changes = {"slug": slug, "conditions": conditions, "courses": [course], "analyses": []}
    document = json.dumps(study | changes)
    site.django(
        "from django.utils import timezone; from experiments import publishing;"
        "from experiments.definition import problems; now = timezone.now();"
        f"row = publishing.store(problems.parse({document!r}.encode()), now);"
        "reason = 'a test drives it';"
        "row.status == 'draft' and publishing.publish(row, None, reason, now, is_confirmed=True)"
    )
    return slug


def come_and_agree(page: Page, name: str) -> None:
    page.get_by_role("link", name="Sign up and take part").click()
    page.get_by_label("User name").fill(name)
    page.get_by_label("Password", exact=True).fill("correct horse battery")
    page.get_by_role("main").get_by_role("button", name="Sign up").click()
    page.get_by_role("button", name="Take part").click()
    page.get_by_label("Your age in years").fill("31")
    page.get_by_label("I have read this and want to take part.").check()
    page.get_by_role("button", name="Agree and continue").click()


def answer_all(page: Page) -> int:
    """Answer all questions page by page; return their number."""
    answered, send = 0, page.get_by_role("button", name=re.compile("^(Send the answers|Next)$"))
    expect(send).to_be_visible()
    while send.is_visible():
        for group in page.get_by_role("group").all():
            choices = group.get_by_role("radio").all()
            if choices:
                choices[min(1, len(choices) - 1)].check()
                answered += 1
        here = page.url
        send.click()
        expect(page).not_to_have_url(here)
        page.wait_for_load_state("domcontentloaded")
    return answered


def read_instructions(page: Page) -> None:
    expect(page.get_by_role("heading", name="How it works")).to_be_visible()
    go_on = page.get_by_role("button", name="I have read this, continue")
    for _ in range(3):
        expect(page.locator("main img")).to_be_visible()
        turn_leaf(page)
    go_on.click()


def take_the_robot(visitor) -> None:
    visitor.page.get_by_role("link", name="Go to the robot").click()
    visitor.page.get_by_role("button", name="Drive Giraff").click()
    visitor.wait_for_picture(30)
    visitor.wait_for("link", "live", 30)
    expect(
        visitor.page.get_by_text("Drive backwards out of the charging station.").first
    ).to_be_visible(timeout=20_000)


def hands_for(page: Page, size: str) -> Keys | Thumb:
    if size != "phone":
        return Keys(page)
    return Thumb(page, Touch(page.context.new_cdp_session(page)))


# longer than the limit of FirstTimeUser, whose error says how far the drive came
@pytest.mark.timeout(900)
@pytest.mark.usefixtures("giraff")
@pytest.mark.parametrize(
    ("size", "condition", "short"),
    [*SHORT, *(pytest.param(*one, marks=pytest.mark.soak) for one in ENDURANCE)],
)
def test_newcomer_completes_the_study_and_takes_part_again(site, visitor, size, condition, short):
    slug = publish(site, condition, short=short)
    nora = visitor(**SIZES[size])
    page, name = nora.page, slug.replace("-", "")
    page.goto(f"/studies/{slug}/?source=5f3a")
    come_and_agree(page, name)
    assert answer_all(page) > 5
    read_instructions(page)
    take_the_robot(nora)
    cues = FirstTimeUser(page, hands_for(page, size)).drive(within=100 if short else 420)
    assert cues[0] == "leave_station", cues
    assert cues[-1] == "completed", cues
    between = {"go_to_checkpoint", "photo_ready", "photo_review", "return_home", "dock_now"}
    assert between <= set(cues), cues

    page.get_by_role("button", name="Continue").click()
    assert answer_all(page) == 8
    expect(page.get_by_role("heading", name="Thanks")).to_be_visible()
    code = page.locator("#code").inner_text()
    user = "SELECT id FROM accounts_user WHERE username = ?"
    mine = f"FROM experiments_participant WHERE user_id = ({user})"
    rows = site.rows(f"SELECT status, completion, completion_code, recruitment, visit {mine}", name)
    assert rows == [("finished", "done", code, json.dumps({"source": "5f3a"}), 1)]
    assert [row[3] for row in site.sessions() if row[1] == name] == ["completed"]
    checkpoints = (
        "SELECT count(*) FROM experiments_taskevent e JOIN experiments_drive d ON d.id = e.drive_id"
        " WHERE e.type = 'checkpoint'"
    )
    passed = site.rows(f"{checkpoints} AND d.participant_id = (SELECT id {mine})", name)
    assert passed == [(2 if short else 4,)]

    page.get_by_role("button", name="Take part again").click()
    read_instructions(page)
    take_the_robot(nora)
    leave = page.get_by_role("button", name="Leave", exact=True)
    leave.first.click()
    expect(page.get_by_role("heading", name="Leave the task?")).to_be_visible()
    leave.last.click()
    states = lambda: [row[2] for row in site.sessions() if row[1] == name]
    wait_for(lambda: states() == ["ended", "ended"], 20, "the end of the second session")
    assert site.rows(f"SELECT visit, status {mine}", name) == [(2, "active")]
