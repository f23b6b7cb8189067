"""Nothing on the drive page and the robot's screen covers a control or a text, and nothing is cut
off: every pair of visible elements, in every scene, at the sizes of a phone in both orientations, a
tablet, a laptop, and a laptop at 200 %.
"""

import itertools
import os
from pathlib import Path

import pytest
from playwright.async_api import Browser, Page

from tests.support.agents.told_task import guide
from tests.support.browsers import drive_page_scenes as scenes
from tests.support.browsers.present_robot_page import ABLE, PresentRobotPage
from tests.support.patience import patient

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]
SIZES = {
    "phone": (390, 844),
    "phone-bars": (390, 664),
    "small-phone": (360, 640),
    "sideways": (844, 390),
    "sideways-bars": (740, 340),
    "tablet": (820, 1180),
    "laptop": (1366, 768),
    "zoomed": (683, 384),
}
KINDS = {
    "fingers": ("", ["phone-bars", "sideways", "tablet"]),
    "spanish": ("spanish", ["phone", "small-phone", "sideways-bars"]),
    "mouse": ("", ["laptop", "zoomed"]),
}
VISITS = {
    "drives": scenes.drives,
    "panels": scenes.opens_panels,
    "docked": scenes.leaves_the_station,
    "task": scenes.does_a_task,
    "waits": scenes.waits,
    "screen": scenes.is_a_screen,
}
ALWAYS = {
    *(("fingers", visit) for visit in ("drives", "panels", "task")),
    *(("mouse", visit) for visit in ("drives", "panels")),
}
SCENES = [
    pytest.param(*pair, marks=() if pair in ALWAYS else pytest.mark.nightly, id="-".join(pair))
    for pair in itertools.product(KINDS, VISITS)
]
SEEN = (
    "button, a[href], input, select, summary, [role=button], .alert, .offer, .pill, .reading,"
    " .hints, .task, .tilt, .pointer, .presence__note, .presence__panel, .photo, .aim, .dial,"
    " .bar__title, .card__title, .card__text, .card__count, .card__guide, .map-panel,"
    " .face__title, .face__text, .face__asked, .face__notice, .face__name, .talk__list"
)
ALERT = "Video is delayed. Driving is paused until it catches up."
SHARES = (-1, 0, 1)  # position of the checkpoint in the video: left, ahead, right
LOOKS = [("", 0), *((ALERT, share) for share in SHARES)]
SETTLED = """async () => {
  await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  return !document.querySelector("#card[data-busy]:not([hidden])");
}"""
FAULTS = """([selector, alert, share]) => {
  // Without a pause, before the page renders again without the alert.
  const [line, arrow] = ["alert", "pointer"].map((id) => document.getElementById(id));
  const [text, hidden] = [line?.textContent, line?.hidden];
  const offered = [...document.querySelectorAll(".offer button")].filter((one) =>
    one.checkVisibility());
  if (alert) {
    line.textContent = alert;
    line.hidden = false;
    arrow.style.setProperty("--share", share);
  }
  if (arrow) arrow.style.transition = "none";
  // The visible part of an element: within all parents that scroll or clip.
  const boxOf = (one) => {
    let { left, top, right, bottom } = one.getBoundingClientRect();
    const page = document.body; // is fixed: the root around it has no height
    for (let around = one.parentElement; around !== page; around = around.parentElement) {
      if (getComputedStyle(around).overflowY !== "visible") {
        const box = around.getBoundingClientRect();
        [left, top] = [Math.max(left, box.left), Math.max(top, box.top)];
        [right, bottom] = [Math.min(right, box.right), Math.min(bottom, box.bottom)];
      }
    }
    return { left, top, right, bottom };
  };
  const card = document.querySelector(".card:not([hidden])");
  // A large map has the video and its texts in its corner.
  const isGround = (one) => one.matches("[data-map=large] .map-panel");
  const isBehindCard = (one, { left, top, right, bottom }) => card
    && !card.contains(one) && one.closest(".stage")
    && card.contains(document.elementFromPoint((left + right) / 2, (top + bottom) / 2));
  const shown = [...document.querySelectorAll(selector)]
    .filter((one) => one.checkVisibility({ opacityProperty: true, visibilityProperty: true })
      && getComputedStyle(one).clipPath !== "inset(50%)" && !isGround(one))
    .map((one) => [one, boxOf(one)])
    .filter(([one, box]) => box.right - box.left > 2 && box.bottom - box.top > 2
      && !isBehindCard(one, box));
  // A centred word that is wider than its button does not scroll to the left.
  const isTooWide = (one) => {
    const words = document.createRange();
    words.selectNodeContents(one);
    return one.childElementCount === 0
      && words.getBoundingClientRect().width > one.clientWidth + 1;
  };
  const name = (one) => one.id || one.dataset.action || one.className || one.textContent.trim();
  const found = [];
  let pairs = 0;
  for (const one of offered) {
    const { top, bottom } = boxOf(one);
    if (bottom - top < 40) found.push(`${one.textContent} gives way to the alert`);
  }
  for (const [i, [one, a]] of shown.entries()) {
    if (a.left < -1 || a.top < -1 || a.right > innerWidth + 1 || a.bottom > innerHeight + 1) {
      found.push(`${name(one)} is outside`);
    }
    if (one.matches("button, .pill") && !one.closest(".map-panel")
      && [one, ...one.children].some((part) => part.clientWidth > 2
        && part.scrollWidth > part.clientWidth + 1)) {
      found.push(`${name(one)}: ${one.textContent.trim()} is cut off`);
    }
    for (const [other, b] of shown.slice(i + 1)) {
      if (one.contains(other) || other.contains(one)) continue;
      pairs += 1;
      const width = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const height = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (width > 1 && height > 1) found.push(`${name(one)} / ${name(other)}`);
    }
  }
  const [ground, sign] = [".stage", ".pointer"]
    .map((part) => document.querySelector(part)?.getBoundingClientRect());
  if (sign?.height && sign.bottom > ground.top + 0.8 * ground.height) {
    found.push("the arrow is at the foot of the video");
  }
  if (alert) [line.textContent, line.hidden] = [text, hidden];
  // A waiting page shows few elements, a driving one many.
  const least = document.querySelector("[data-phase=driving]") && !card ? [16, 100] : [3, 2];
  if (shown.length < least[0] || pairs < least[1]) {
    found.push(`only ${shown.length} things and ${pairs} pairs of them were compared`);
  }
  const stage = document
    .querySelector("[data-phase=driving]:not([data-map=large], :has(.task[data-open]"
      + ", .places:not([hidden]))) .stage")
    ?.getBoundingClientRect();
  const shownShare = stage ? (stage.width * stage.height) / (innerWidth * innerHeight) : 1;
  if (innerWidth < innerHeight && innerHeight > 800 && shownShare < 0.5) {
    found.push(`the video has ${shownShare.toFixed(2)} of the screen`);
  }
  // An enlarged plan takes half of an upright screen, with nothing over it, and is never a sliver.
  const [panel, plan, video] = [".map-panel", "#map", ".stage"]
    .map((part) => document.querySelector(`[data-phase=driving] ${part}`)?.getBoundingClientRect());
  const isUpright = innerWidth < innerHeight;
  const isLarge = document.querySelector("[data-map=large]");
  const isOpened = document.querySelector(".task[data-open]");
  if (panel && isLarge && isUpright && !card && !document.querySelector(".photo:not([hidden])")) {
    const height = innerHeight > 800 ? plan.height : panel.height;
    const share = height / innerHeight;
    if (share < (isOpened ? 0.4 : 0.5)) found.push(`the map has ${share.toFixed(2)} of the screen`);
    if (video.top < plan.bottom) found.push("the video lies over the map");
  } else if (panel && panel.height < 60) {
    found.push(`the map is ${Math.round(panel.height)} high`);
  }
  const places = document.querySelector(".places:not([hidden])")?.getBoundingClientRect();
  if (places && isUpright && places.height < 140) {
    found.push(`the list of places is ${Math.round(places.height)} high`);
  }
  for (const one of document.querySelectorAll("[data-phase=driving] .speed__step")) {
    if (one.checkVisibility() && isTooWide(one)) found.push(`${one.textContent} is cut off`);
  }
  for (const one of document.querySelectorAll(".bar__button, .presence__button, .map-tool")) {
    const isNamed = one.ariaLabel || one.textContent.trim();
    if (!isNamed) found.push(`${name(one)} has no name`);
  }
  return found;
}"""
EACH = f"""([selector, looks]) => {{
  const faults = {FAULTS};
  return looks.slice(0, document.getElementById("alert") ? looks.length : 1)
    .map((look) => faults([selector, ...look]));
}}"""


async def look(page: Page, size: str, scene: str, kind: str) -> list[str]:
    width, height = SIZES[size]
    await page.set_viewport_size({"width": width, "height": height})
    if not await page.evaluate(SETTLED):  # on a busy computer the page may reconnect
        busy = page.locator("#card[data-busy]")
        await busy.wait_for(state="hidden", timeout=1000 * patient(30.0))
    faults = await page.evaluate(EACH, [SEEN, LOOKS])
    found = [
        f"{scene}, {size}{f', alert, arrow at {share}' * bool(alert)}: {one}"
        for (alert, share), seen in zip(LOOKS, faults, strict=False)  # a screen has no alert
        for one in seen
    ]
    if folder := os.environ.get("SCREENSHOTS"):
        await page.screenshot(path=Path(folder) / f"{scene}-{size}-{kind}.png".replace(", ", "-"))
    return found


@pytest.mark.parametrize(("kind", "visit"), SCENES)
async def test_no_control_is_covered_in_any_scene_at_any_size(
    browser: Browser, kind: str, visit: str
):
    path, sizes = KINDS[kind]
    start = "dock" if visit == "docked" else "lab-before-door"
    study = guide() if visit == "task" else None
    touch = kind != "mouse"
    wrong: list[str] = []
    with PresentRobotPage(capabilities=ABLE, start=start, study=study) as site:
        context = await browser.new_context(
            viewport={"width": 1366, "height": 768}, has_touch=touch, is_mobile=touch
        )
        page = await context.new_page()
        page.set_default_timeout(1000 * patient(20.0))
        async for scene in VISITS[visit](page, site, site.url + path):
            for size in sizes:
                wrong += await look(page, size, scene, kind)
        await context.close()
    assert wrong == [], "\n".join(wrong)


@pytest.fixture(scope="module")
def flags() -> list[str]:
    return ["--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream"]
