"""A course is drawn on the floor plan, in a real browser: with the mouse, with a finger, and with
keys.
"""

import pytest
from playwright.sync_api import expect

from telepresence_site.serving import APPLICATION, DAPHNE
from tests.support.sessions.site import Site, wait_for

pytestmark = pytest.mark.browser
SETUP = """
from django.utils import timezone
from accounts.models import User
from experiments import publishing
from experiments.definition.shipped import shipped
from experiments.models import Study
User.objects.filter(username={name!r}).update(is_staff=True, is_superuser=True)
Study.objects.filter(slug='exploration').delete()
print(publishing.store(shipped()['exploration'], timezone.now()).pk)
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The web server alone: nothing is driven here."""
    site = Site(tmp_path_factory.mktemp("site"))
    try:
        site.prepare()
        site.start("web", [*DAPHNE, "-b", site.bind, "-p", str(site.web_port), APPLICATION])
        wait_for(lambda: site.listening(site.web_port), 60, "the web server")
        yield site
    finally:
        site.stop_all()


@pytest.fixture
def course(site, visitor):
    """Open the course of the shipped study for somebody who owns it."""

    def open_it(name: str, **context):
        site.sign_in(name)
        study = site.django(
            ";".join(line for line in SETUP.format(name=name).strip().splitlines())
        ).strip()
        page = visitor(name, **context).page
        page.goto(f"/admin/experiments/study/{study}/build/courses/0/")
        return page

    return open_it


def place(page, n: int) -> tuple[float, float]:
    return tuple(
        float(page.locator(f'[name="checkpoints.{n}.{axis}"]').input_value()) for axis in "xy"
    )


def middle(page, n: int) -> tuple[float, float]:
    """Return where a checkpoint's handle is on the screen: of what stays when the map is drawn
    anew, and once nothing moves the map any more.
    """
    expect(page.locator("#course-check")).not_to_be_empty()
    handle = page.get_by_role("button", name=f"Checkpoint {n}: ")
    handle.scroll_into_view_if_needed()
    box = handle.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


@pytest.mark.nightly
def test_the_mouse_and_the_keys_move_a_checkpoint_and_the_server_says_what_is_not_reached(course):
    page = course("mina")
    assert place(page, 3) == (9.6, 4.4)
    x, y = middle(page, 3)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 20, y, steps=3)
    page.mouse.move(x + 40, y + 20, steps=3)
    page.mouse.up()
    dragged = place(page, 3)
    assert dragged[0] > 9.8
    assert dragged[1] < 4.3
    page.get_by_role("button", name="Checkpoint 3: ").focus()
    page.keyboard.press("ArrowUp")
    page.keyboard.press("Shift+ArrowLeft")
    assert place(page, 3) == pytest.approx((dragged[0] - 0.02, dragged[1] + 0.1))
    page.locator('[name="checkpoints.3.x"]').fill("30")
    expect(page.locator("#course-check")).to_contain_text(
        "checkpoint 3 is not in a room; move it into one."
    )
    expect(page.locator(".is-unreachable")).to_have_count(1)


def test_a_click_adds_a_checkpoint_and_a_point_of_the_path(course):
    page = course("mona")
    # the map is drawn, and nothing moves it any more
    expect(page.locator("#course-check")).not_to_be_empty()
    path = page.locator('[name="path"]')
    before = len(path.input_value().splitlines())
    page.get_by_label("Add to the path").check()
    box = page.locator("#course-map").bounding_box()
    page.locator("#course-map").click(position={"x": box["width"] * 0.5, "y": box["height"] * 0.8})
    wait_for(
        lambda: len(path.input_value().splitlines()) == before + 1, 5, "one more point of the path"
    )
    page.get_by_label("Add a checkpoint").check()
    page.locator("#course-map").click(position={"x": box["width"] * 0.4, "y": box["height"] * 0.35})
    expect(page.get_by_role("group", name="Checkpoint 5", exact=True)).to_be_visible()
    page.get_by_role("button", name="Remove Checkpoint 5").click()
    expect(page.get_by_role("group", name="Checkpoint 5", exact=True)).to_have_count(0)


def test_a_finger_moves_a_checkpoint_on_a_phone(course):
    page = course("tina", viewport={"width": 390, "height": 844}, has_touch=True)
    x, y = middle(page, 3)
    fingers = page.context.new_cdp_session(page)
    fingers.send(
        "Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]}
    )
    for step in range(1, 6):
        fingers.send(
            "Input.dispatchTouchEvent",
            {"type": "touchMove", "touchPoints": [{"x": x + 4 * step, "y": y}]},
        )
    fingers.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    wait_for(lambda: place(page, 3)[0] > 9.9, 5, "a checkpoint that was moved")
    moved = place(page, 3)
    assert moved[1] == pytest.approx(4.4, abs=0.1)
