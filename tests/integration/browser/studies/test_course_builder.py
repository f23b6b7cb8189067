"""A course is drawn on the floor plan in a real browser: with the mouse, a finger, and keys."""

import pytest
from playwright.sync_api import expect

from tests.support.browsers.first_time_user import drag_with_finger
from tests.support.programs.server import web_alone
from tests.support.sessions.site import wait_for

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
    with web_alone(tmp_path_factory.mktemp("site")) as site:
        yield site


@pytest.fixture
def course(site, visitor):
    """Open the course of the shipped study as its owner."""

    def open_it(name: str, **context):
        site.sign_in(name)
        study = site.django(SETUP.format(name=name)).strip()
        page = visitor(name, **context).page
        page.goto(f"/admin/experiments/study/{study}/build/courses/0/")
        return page

    return open_it


def place(page, n: int) -> tuple[float, float]:
    return tuple(
        float(page.locator(f'[name="checkpoints.{n}.{axis}"]').input_value()) for axis in "xy"
    )


def middle(page, n: int) -> tuple[float, float]:
    """Return where a checkpoint's handle is on the screen, once the map does not move any more."""
    expect(page.locator("#course-check")).not_to_be_empty()
    handle = page.get_by_role("button", name=f"Checkpoint {n}: ")
    handle.scroll_into_view_if_needed()
    box = handle.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


@pytest.mark.nightly
def test_mouse_and_keys_move_a_checkpoint_and_the_server_checks_it(course):
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


def test_click_adds_a_checkpoint_and_a_point_of_the_path(course):
    page = course("mona")
    # the map does not move any more
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


def test_finger_moves_a_checkpoint_on_a_phone(course):
    page = course("tina", viewport={"width": 390, "height": 844}, has_touch=True)
    x, y = middle(page, 3)
    drag_with_finger(page, x, y, 20)
    wait_for(lambda: place(page, 3)[0] > 9.9, 5, "a checkpoint that was moved")
    moved = place(page, 3)
    assert moved[1] == pytest.approx(4.4, abs=0.1)
