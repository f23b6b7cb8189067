"""Questionnaires in a real Chromium: desktop and phone, a lost network, reloads, conditions,
sliders and rankings.
"""

import pytest
from axe_playwright_python.sync_playwright import Axe
from django.urls import reverse
from playwright.sync_api import expect

from surveys.editor.labels import ready_points
from surveys.models import Answer, Response
from surveys.questionnaires import current, store
from surveys.responses import Context, Respondent, begin
from tests.support.browsers.first_time_user import Touch
from tests.support.media.photographs import keep
from tests.support.people import person
from tests.support.studies.questionnaires import NOW, defined, item, rows

pytestmark = [pytest.mark.browser, pytest.mark.django_db(transaction=True)]
PHONE, DESKTOP = {"width": 390, "height": 844}, {"width": 1280, "height": 800}
KINDS = [
    item("grid", "g", rows=rows("g1", "g2")),
    item("single", "s"),
    item("text", "why", show_if={"item": "s", "is": ["c"]}),
    item("multiple", "m", not_applicable=True),
    item("slider", "x", step=5),
    item("number", "n", maximum=5),
    item("text", "t", prefer_not=True),
]

RANKED = [
    item("ranking", "r", prefer_not=True),
    item("text", "why", show_if={"item": "r", "is": ["c"]}),
]


@pytest.fixture
def respondent(open_page):
    """Open a questionnaire as ada."""

    def open_(questionnaire, viewport=DESKTOP, language="en", **context):
        user = person()
        page = open_page(user, viewport=viewport, **context)
        asked = Context(key="c", robot=("giraff",))
        row = begin(questionnaire, Respondent(user=user), asked, language=language, seed=1, now=NOW)
        page.goto(reverse("survey", args=[row.pk]))
        return page

    return open_


# Words of labels that are broken into lines.
BROKEN_WORDS = """[...document.querySelectorAll(".choice label")].flatMap((label) =>
  [...label.childNodes].filter((node) => node.nodeType === 3).flatMap((node) =>
    [...node.data.matchAll(/\\S+/g)].filter((word) => {
      const range = document.createRange();
      range.setStart(node, word.index);
      range.setEnd(node, word.index + word[0].length);
      return range.getClientRects().length > 1;
    }).map((word) => word[0])))"""


@pytest.mark.parametrize("language", ["en", "es"])
@pytest.mark.parametrize("width", [390, 820, 1280, 1366])
def test_labels_of_seven_points_break_no_words(respondent, width, language):
    words = ready_points("agreement_7", [language])
    points = [{**one, "label": {"en": one["label"][language]}} for one in words]
    asked = item("grid", "g", rows=rows("g1", "g2"), scale="agreement", prefer_not=True)
    items = [asked, item("likert", "l", scale="agreement")]
    document = defined(items, scales={"agreement": points})
    page = respondent(store(document, NOW), {"width": width, "height": 900})
    keep(page, f"agreement-7-{language}-{width}", whole=True)
    assert page.locator(".choice label").count() >= 21
    assert page.evaluate(BROKEN_WORDS) == []
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


def stored(page) -> dict:
    expect(page.locator("[data-status]")).to_have_attribute("data-state", "saved")
    return {row.item: row.missing or row.value for row in Answer.objects.all()}


@pytest.mark.parametrize("slug", ["ict", "experience", "sus", "tlx"])
@pytest.mark.parametrize("viewport", [PHONE, DESKTOP], ids=["phone", "desktop"])
def test_pages_fit_the_screen_and_choices_fit_a_thumb(respondent, slug, viewport):
    page = respondent(current(slug, NOW), viewport)
    assert page.evaluate("document.documentElement.scrollWidth") <= viewport["width"]
    sizes = page.locator(
        ".choice label, .reason label, .slider__range, .survey__foot .button"
    ).evaluate_all("all => all.map(e => e.getBoundingClientRect().height)")
    assert sizes
    assert min(sizes) >= 44


OVERLAPS = """() => {
  const boxes = [...document.querySelectorAll(".choice label, .reason label")].map((one) => {
    const words = document.createRange();
    words.selectNodeContents(one);
    const [box, text] = [one.getBoundingClientRect(), words.getBoundingClientRect()];
    return { name: `${one.htmlFor} ${one.textContent}`, top: box.top, bottom: box.bottom,
      left: Math.min(box.left, text.left), right: Math.max(box.right, text.right) };
  });
  return boxes.flatMap((one, i) => boxes.slice(i + 1)
    .filter((two) => one.left < two.right - 1 && two.left < one.right - 1
      && one.top < two.bottom - 1 && two.top < one.bottom - 1)
    .map((two) => `${one.name} / ${two.name}`));
}"""


@pytest.mark.parametrize("width", [844, 1024, 1366])
def test_long_choices_do_not_overlap(respondent, width):
    page = respondent(
        current("experience", NOW), {"width": width, "height": 768}, language="es", locale="es"
    )
    expect(page.get_by_text("Muy en desacuerdo").first).to_be_visible()
    assert page.evaluate(OVERLAPS) == []


def test_every_answer_is_saved_at_once(respondent):
    page = respondent(store(defined(KINDS), NOW))
    page.get_by_role("group", name="Row g1").get_by_label("Yes").check()
    assert stored(page) == {"g1": 1}
    page.get_by_role("group", name="Text of m").get_by_label("B").check()
    page.get_by_role("group", name="Text of m").get_by_label("Does not apply").check()
    expect(page.get_by_role("group", name="Text of m").get_by_label("B")).not_to_be_checked()
    page.get_by_label("Text of t").fill("hello")
    page.get_by_label("Text of t").blur()
    expect(page.locator("[data-status]")).to_have_text("Saved")
    page.wait_for_load_state("networkidle")
    assert stored(page) == {"g1": 1, "m": "not_applicable", "t": "hello"}
    assert all(seconds > 0 for seconds in Answer.objects.values_list("seconds", flat=True))
    page.reload()
    expect(page.get_by_label("Text of t")).to_have_value("hello")
    expect(page.get_by_role("group", name="Row g1").get_by_label("Yes")).to_be_checked()


def test_answer_shows_the_dependent_question_and_clearing_hides_it(respondent):
    page = respondent(store(defined(KINDS), NOW))
    why = page.get_by_label("Text of why")
    expect(why).to_be_hidden()
    page.get_by_role("group", name="Text of s").get_by_label("C").check()
    expect(why).to_be_visible()
    page.get_by_role("button", name="Clear : Text of s").click()
    expect(why).to_be_hidden()
    page.wait_for_load_state("networkidle")
    assert stored(page) == {"s": "skipped"}


def test_slider_is_unanswered_until_it_is_touched(respondent):
    page = respondent(store(defined(KINDS), NOW))
    number, rail = page.get_by_label("Text of x"), page.locator(".slider__range")
    expect(number).to_have_value("")
    expect(rail).to_have_attribute("data-empty", "")
    rail.click()
    expect(number).to_have_value("50")
    page.wait_for_load_state("networkidle")
    assert stored(page) == {"x": 50}
    number.fill("35")
    number.blur()
    expect(rail).to_have_js_property("value", "35")


def order_of(page) -> str:
    """Return the options in their order, each with its place."""
    return " ".join(
        page.locator(".ranking__row").evaluate_all(
            "all => all.map(row => row.querySelector('label').textContent"
            " + row.querySelector('select').selectedIndex)"
        )
    )


def handle_of(page, option: str):
    rows = page.locator(".ranking__row").filter(has=page.get_by_label(option, exact=True))
    return rows.locator(".ranking__handle")


def test_ranking_by_keyboard_keeps_the_focus_on_its_option(respondent):
    page = respondent(store(defined(RANKED), NOW))
    assert order_of(page) == "A0 B0 C0"
    expect(page.get_by_label("Text of why")).to_be_hidden()
    page.get_by_label("C", exact=True).focus()
    page.keyboard.type("1")
    expect(page.get_by_label("C", exact=True)).to_be_focused()
    assert order_of(page) == "C1 A2 B3"
    assert stored(page) == {"r": ["c", "a", "b"]}
    expect(page.get_by_label("Text of why")).to_be_visible()
    page.get_by_label("B", exact=True).select_option("2")
    assert order_of(page) == "C1 B2 A3"
    page.wait_for_load_state("networkidle")
    assert stored(page) == {"r": ["c", "b", "a"]}
    page.reload()
    assert order_of(page) == "C1 B2 A3"


def test_declined_or_cleared_ranking_has_no_places(respondent):
    page = respondent(store(defined(RANKED), NOW))
    page.get_by_label("B", exact=True).select_option("1")
    page.get_by_label("Prefer not to answer").check()
    assert order_of(page) == "B0 A0 C0"
    page.wait_for_load_state("networkidle")
    assert stored(page) == {"r": "preferred_not"}
    page.get_by_label("C", exact=True).select_option("3")
    expect(page.get_by_label("Prefer not to answer")).not_to_be_checked()
    page.get_by_role("button", name="Clear : Text of r").click()
    assert order_of(page) == "B0 A0 C0"
    page.wait_for_load_state("networkidle")
    assert stored(page) == {"r": "skipped"}


def test_option_is_dragged_with_the_mouse_and_the_first_order_counts(respondent):
    page = respondent(store(defined(RANKED), NOW))
    handle_of(page, "B").click()
    assert order_of(page) == "A1 B2 C3"
    assert stored(page) == {"r": ["a", "b", "c"]}
    last = handle_of(page, "C").bounding_box()
    handle_of(page, "A").hover()
    page.mouse.down()
    page.mouse.move(last["x"], last["y"] + last["height"], steps=5)
    page.mouse.up()
    assert order_of(page) == "B1 C2 A3"
    page.wait_for_load_state("networkidle")
    assert stored(page) == {"r": ["b", "c", "a"]}


def test_option_dragged_by_finger_returns_when_the_touch_is_cancelled(respondent):
    page = respondent(store(defined(RANKED), NOW), PHONE, has_touch=True)
    boxes = {name: handle_of(page, name).bounding_box() for name in "AC"}
    finger = Touch(page.context.new_cdp_session(page))
    x, y = boxes["C"]["x"] + 20, boxes["C"]["y"] + 20
    finger.down(x, y)
    first = page.locator(".ranking__row").first
    finger.move(x, (y + boxes["A"]["y"]) / 2)
    finger.move(x, boxes["A"]["y"])
    expect(first).to_contain_text("C")
    assert order_of(page) == "C0 A0 B0"
    finger.cancel()
    expect(first).to_contain_text("A")
    assert order_of(page) == "A0 B0 C0"
    finger.down(x, y)
    finger.move(x, boxes["A"]["y"])
    expect(first).to_contain_text("C")
    finger.up()
    expect(page.get_by_label("C", exact=True)).to_have_value("1.c")
    assert order_of(page) == "C1 A2 B3"
    assert stored(page) == {"r": ["c", "a", "b"]}


@pytest.mark.parametrize("viewport", [PHONE, DESKTOP], ids=["phone", "desktop"])
def test_ranking_fits_the_screen_and_the_thumb_and_is_accessible(respondent, viewport):
    long = [{"value": v, "label": {"en": f"{v} {'very long words ' * 6}"}} for v in "xyz"]
    asked = [*RANKED, item("ranking", "long", options=long)]
    page = respondent(store(defined(asked), NOW), viewport, reduced_motion="reduce")
    assert page.evaluate("document.documentElement.scrollWidth") <= viewport["width"]
    sizes = page.locator(".ranking__row :is(select, label, .ranking__handle)").evaluate_all(
        "all => all.map(e => e.getBoundingClientRect().height)"
    )
    assert len(sizes) == 18
    assert min(sizes) >= 44
    keep(page, f"ranking-{viewport['width']}")
    page.get_by_label("B", exact=True).select_option("1")
    keep(page, f"ranked-{viewport['width']}")
    assert Axe().run(page).response["violations"] == []


def test_ranking_without_network_survives_a_reload(respondent):
    page = respondent(store(defined(RANKED), NOW))
    page.route("**/answer/", lambda route: route.abort())
    page.get_by_label("C", exact=True).select_option("2")
    expect(page.locator("[data-status]")).to_contain_text("No connection")
    page.unroute("**/answer/")
    page.reload()
    assert order_of(page) == "A1 C2 B3"
    assert stored(page) == {"r": ["a", "c", "b"]}


def test_ranking_without_javascript_uses_lists_of_places(respondent):
    page = respondent(store(defined(RANKED), NOW), PHONE, java_script_enabled=False)
    for option, place in (("A", "3"), ("B", "1"), ("C", "1")):
        page.get_by_label(option, exact=True).select_option(place)
    page.get_by_role("button", name="Send the answers").click()
    expect(page.locator("#q-r-error")).to_have_text("Give each option a different place.")
    expect(page.get_by_label("A", exact=True)).to_have_value("3.a")
    page.get_by_label("C", exact=True).select_option("2")
    page.get_by_role("button", name="Send the answers").click()
    expect(page.get_by_text("this page has more questions")).to_have_count(0)
    expect(page.get_by_role("heading", name="Thank you")).to_be_visible()
    assert Answer.objects.get(item="r").value == ["b", "c", "a"]


def test_answer_out_of_range_has_an_error_beside_it(respondent):
    page = respondent(store(defined(KINDS), NOW))
    page.get_by_label("Text of n").fill("9")
    page.get_by_label("Text of n").blur()
    expect(page.locator("#q-n-error")).to_have_text("Enter a number of at most 5.")
    page.get_by_label("Text of n").fill("4")
    page.get_by_label("Text of n").blur()
    expect(page.locator("#q-n-error")).to_be_hidden()
    assert stored(page) == {"n": 4.0}


def test_answer_without_network_survives_a_reload_and_is_sent_later(respondent):
    page = respondent(store(defined(KINDS), NOW))
    page.route("**/answer/", lambda route: route.abort())
    page.get_by_role("group", name="Row g2").get_by_label("No").check()
    expect(page.locator("[data-status]")).to_contain_text("No connection")
    assert not Answer.objects.exists()
    page.reload()
    expect(page.get_by_role("group", name="Row g2").get_by_label("No")).to_be_checked()
    page.unroute("**/answer/")
    assert stored(page) == {"g2": -1}


def test_page_without_network_is_not_replaced_by_an_error_page(respondent):
    page = respondent(store(defined(KINDS), NOW))
    page.context.set_offline(True)
    page.get_by_label("Text of t").fill("kept")
    page.get_by_role("button", name="Send the answers").click()
    expect(page.locator("[data-status]")).to_contain_text("No connection")
    expect(page.get_by_label("Text of t")).to_have_value("kept")
    page.context.set_offline(False)
    page.get_by_role("button", name="Send the answers").click()
    expect(page.get_by_role("heading", name="Thank you")).to_be_visible()
    assert Answer.objects.get(item="t").value == "kept"
    assert Response.objects.get().finished_at is not None


def test_questionnaire_is_answered_without_javascript(respondent):
    page = respondent(store(defined(KINDS), NOW), PHONE, java_script_enabled=False)
    page.get_by_role("group", name="Text of s").get_by_label("C").check()
    page.get_by_label("Text of x").fill("65")
    page.get_by_role("button", name="Send the answers").click()
    expect(page.get_by_text("this page has more questions")).to_be_visible()
    page.get_by_label("Text of why").fill("because")
    page.get_by_role("button", name="Send the answers").click()
    expect(page.get_by_role("heading", name="Thank you")).to_be_visible()
    values = {row.item: row.missing or row.value for row in Answer.objects.all()}
    skipped = dict.fromkeys(("g1", "g2", "m", "n", "t"), "skipped")
    assert values == {**skipped, "s": "c", "why": "because", "x": 65}


def test_logged_out_respondent_loses_no_answer(respondent):
    page = respondent(store(defined(KINDS), NOW))
    cookies = page.context.cookies()
    page.context.clear_cookies(name="sessionid")
    page.get_by_role("group", name="Row g1").get_by_label("Yes").check()
    expect(page.locator("[data-status]")).to_contain_text("You are logged out")
    assert not Answer.objects.exists()
    page.context.add_cookies(cookies)
    page.reload()
    expect(page.get_by_role("group", name="Row g1").get_by_label("Yes")).to_be_checked()
    assert stored(page) == {"g1": 1}
