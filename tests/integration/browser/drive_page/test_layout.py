"""Nothing on the drive page lies over a control: every pair of what is visible, at the sizes of a
phone both ways, a tablet, a laptop, and a laptop at 200 %.
"""

import os
from pathlib import Path

import pytest
from playwright.async_api import Browser, Page

from tests.support.drive_page import driving
from tests.support.patience import patient
from tests.support.present_robot_page import CAPABILITIES, PresentRobotPage
from tests.support.told_task import guide, tell

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]
ABLE = (*CAPABILITIES, "goto", "dock", "undock", "relocalize", "scan", "assist")
SIZES = {
    "phone": (390, 844),
    "sideways": (844, 390),
    "tablet": (820, 1180),
    "laptop": (1366, 768),
    "zoomed": (683, 384),
}
SEEN = (
    "button, a[href], input, select, summary, [role=button], .alert, .offer, .card, .pill,"
    " .reading, .hints, .task, .tilt, .pointer, .presence__note, .dial, .bar__title"
)
ALERT = "Video is delayed. Driving is paused until it catches up."
SHARES = (-1, 0, 1)  # where in the video the checkpoint lies: at the left, ahead, at the right
OVERLAPS = """([selector, alert, share]) => {
  // At once, before the page renders again: it knows of no alert.
  const [box, arrow] = ["alert", "pointer"].map((id) => document.getElementById(id));
  if (alert) {
    box.textContent = alert;
    box.hidden = false;
    arrow.style.setProperty("--share", share);
    arrow.style.transition = "none";
  }
  const shown = [...document.querySelectorAll(selector)].filter((one) => {
    const style = getComputedStyle(one);
    const box = one.getBoundingClientRect();
    return one.checkVisibility({ opacityProperty: true, visibilityProperty: true })
      && box.width > 2 && box.height > 2 && style.clipPath !== "inset(50%)";
  });
  const name = (one) => one.id || one.dataset.action || one.className || one.textContent.trim();
  const found = [];
  const outside = [];
  for (const [i, one] of shown.entries()) {
    const a = one.getBoundingClientRect();
    if (a.left < -1 || a.top < -1 || a.right > innerWidth + 1 || a.bottom > innerHeight + 1) {
      outside.push(name(one));
    }
    for (const other of shown.slice(i + 1)) {
      if (one.contains(other) || other.contains(one)) continue;
      const b = other.getBoundingClientRect();
      const width = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const height = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (width > 1 && height > 1) found.push(`${name(one)} / ${name(other)}`);
    }
  }
  if (alert) box.hidden = true;
  const stage = document.querySelector("#viewport").getBoundingClientRect();
  return { found, outside, video: (stage.width * stage.height) / (innerWidth * innerHeight) };
}"""


async def look(page: Page, size: str, state: str, kind: str = "") -> list[str]:
    width, height = SIZES[size]
    await page.set_viewport_size({"width": width, "height": height})
    await page.wait_for_timeout(500)
    # A card is what lies over the video where there is none: on a busy computer, while it connects.
    await page.locator("#card").wait_for(state="hidden", timeout=1000 * patient(30.0))
    found = await page.evaluate(OVERLAPS, [SEEN, "", 0])
    if folder := os.environ.get("SCREENSHOTS"):
        await page.screenshot(path=Path(folder) / f"layout-{state}-{size}{kind}.png")
    wrong = [f"{state}, {size}: {pair}" for pair in found["found"]]
    wrong += [f"{state}, {size}: {name} is cut off" for name in found["outside"]]
    if size in {"phone", "tablet"} and found["video"] < 0.5:
        wrong.append(f"{state}, {size}: the video has {found['video']:.0%} of the screen")
    for share in SHARES:
        alerted = await page.evaluate(OVERLAPS, [SEEN, ALERT, share])
        wrong += [
            f"{state}, {size}, alert, arrow at {share}: {pair}"
            for pair in (*alerted["found"], *(f"{name} is cut off" for name in alerted["outside"]))
        ]
    return wrong


@pytest.mark.parametrize("kind", ["fingers", "mouse"])
async def test_nothing_lies_over_a_control_at_any_size(browser: Browser, kind: str):
    wrong: list[str] = []
    sizes = [name for name in SIZES if kind == "fingers" or name in {"laptop", "zoomed"}]
    touch = kind == "fingers"
    for start, study in (("lab-before-door", None), ("dock", None), ("lab-before-door", guide())):
        with PresentRobotPage(capabilities=ABLE, start=start, study=study) as site:
            context = await browser.new_context(
                viewport={"width": 1366, "height": 768}, has_touch=touch, is_mobile=touch
            )
            page = await context.new_page()
            await page.goto(f"{site.url}?go=1")
            await driving(page)
            await page.wait_for_timeout(1500)
            state = "study" if study else start
            if study:
                tell(site, "go_to_checkpoint", number=2, x=8.4, y=1.0, passed=(1,), remaining=119.0)
                await page.get_by_text("Go to checkpoint 2.", exact=True).first.wait_for()
            for size in sizes:
                wrong += await look(page, size, state, "" if touch else "-mouse")
            await context.close()
    assert wrong == [], "\n".join(wrong)
