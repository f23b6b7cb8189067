"""Sound, video and messages between a visitor's browser and the robot's display, both real
Chromiums, measured at the receiver.
"""

import asyncio
import wave
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pytest_asyncio
from axe_playwright_python.async_playwright import Axe
from playwright.async_api import Browser, Page

from robots.api import messages as m
from tests.support.browsers.chromium import CHROMIUM, FLAGS
from tests.support.browsers.drive_page import driving, evaluated, hold, note_errors
from tests.support.browsers.present_robot_page import PresentRobotPage
from tests.support.media.photographs import kept
from tests.support.paths import ROOT
from tests.support.patience import patient, until

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]
Open = Callable[..., Awaitable[Page]]
HERTZ = 880.0
FAKE = [
    "--use-fake-device-for-media-stream",
    "--use-fake-ui-for-media-stream",
    "--auto-select-tab-capture-source-by-title=Giraff",
]
# Chromium's fake camera is green, but for a pie and a counter.
COLOUR = """() => {
  const video = document.querySelector("#video");
  if (!video.videoWidth) return null;
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 16;
  const brush = canvas.getContext("2d");
  brush.drawImage(video, 0, 0, 16, 16);
  const data = brush.getImageData(0, 0, 16, 16).data;
  const mean = [0, 1, 2].map((part) =>
    data.filter((_, at) => at % 4 === part).reduce((sum, value) => sum + value, 0) / 256);
  return mean;
}"""
TONE = """() => {
  const page = globalThis;
  if (!page.listening) {
    const context = new AudioContext();
    const analyser = context.createAnalyser();
    analyser.fftSize = 8192;
    context.createMediaStreamSource(document.querySelector("#audio").srcObject).connect(analyser);
    page.listening = { context, analyser, stream: document.querySelector("#audio").srcObject };
  }
  const { context, analyser } = page.listening;
  const bins = new Float32Array(analyser.frequencyBinCount);
  analyser.getFloatFrequencyData(bins);
  const loudest = bins.indexOf(Math.max(...bins));
  return { hertz: (loudest * context.sampleRate) / analyser.fftSize, level: bins[loudest] };
}"""


@pytest.fixture
def site():
    with PresentRobotPage() as fake:
        yield fake


def tone(path: Path) -> Path:
    """Write ten seconds of a sine, which Chromium's fake microphone repeats."""
    samples = 12_000 * np.sin(2 * np.pi * HERTZ * np.arange(480_000) / 48_000)
    with wave.open(str(path), "wb") as file:
        file.setparams((1, 2, 48_000, 0, "NONE", ""))
        file.writeframes(samples.astype("<i2").tobytes())
    return path


@pytest.fixture(scope="module")
def flags(tmp_path_factory) -> list[str]:
    sound = tone(tmp_path_factory.mktemp("sound") / "tone.wav")
    return [*FAKE, f"--use-file-for-fake-audio-capture={sound}"]


@pytest_asyncio.fixture(loop_scope="module")
async def opened(browser) -> AsyncIterator[Open]:
    """Open pages; no script of theirs may fail."""
    complaints: list[str] = []

    async def open_page(address: str, **context: Any) -> Page:
        size = {"width": 1280, "height": 800}
        page = await (await browser.new_context(viewport=size, **context)).new_page()
        note_errors(page, complaints)
        await page.goto(address)
        return page

    yield open_page
    assert complaints == []


async def drives(opened: Open, site: PresentRobotPage, **context: Any) -> Page:
    page = await opened(site.url, **context)
    await page.click("text=Drive Giraff")
    await driving(page)
    return page


def is_green(colour) -> bool:
    red, green, blue = colour
    return green > 60 and green > red + 30 and green > blue + 30


def is_loud(sound) -> bool:
    return abs(sound["hertz"] - HERTZ) < 15 and sound["level"] > -60


@pytest.mark.nightly
async def test_sound_video_and_messages_pass_between_page_and_robot(opened, site) -> None:
    page = await drives(opened, site, permissions=["microphone", "camera"])
    assert site.speaker.played == 0, "nothing is sent before a click"

    # The robot's own outputs, while it has no screen.
    await page.click("#presence-mic")
    await page.click("#presence-camera")
    await until(lambda: abs(site.speaker.tone - HERTZ) < 15 and site.speaker.level > 0.02, 15)
    await until(lambda: site.display.colour and is_green(site.display.colour), 15)
    await page.wait_for_selector("#presence-note[data-sending] >> text=They can see and hear you.")

    # Its screen, which takes over.
    screen = await opened(site.screen_url)
    await screen.wait_for_selector("#face[data-scene=seen][data-live]")
    assert is_green(await evaluated(screen, COLOUR, is_green))
    await evaluated(screen, TONE, is_loud)
    assert await screen.text_content("#name-text") == "Ana is visiting"

    # The visitor gets the robot's sound and video.
    assert await page.evaluate("() => document.querySelector('#video').videoWidth") > 0
    await evaluated(page, TONE, lambda found: found["level"] > -80)

    # Muted, but not while T is down.
    await page.click("#presence-mic")
    await evaluated(screen, TONE, lambda found: found["level"] < -90)
    await page.keyboard.down("t")
    await evaluated(screen, TONE, is_loud)
    await page.keyboard.up("t")
    await page.wait_for_selector("text=They can see you but not hear you. Hold T to talk.")

    # Text never drives; afterwards the keys do.
    await screen.evaluate(
        "() => { globalThis.spoken = []; speechSynthesis.speak = (one) => {"
        " spoken.push([one.text, one.lang]); one.onstart(); globalThis.done = one.onend; }; }"
    )
    before = len(site.applied)
    await page.click("#presence-talk")
    await page.check("#talk-aloud")
    await page.fill("#talk-field", "")
    await page.type("#talk-field", "was hello wasd")
    assert len(site.applied) == before
    await page.press("#talk-field", "Enter")
    await screen.wait_for_selector("#messages >> text=was hello wasd")
    assert await screen.evaluate("spoken") == [["was hello wasd", "en"]]
    own = page.locator("#talk-list .line--own")
    await own.locator("text=Shown on the robot's screen").wait_for()
    await screen.evaluate("done()")
    await own.locator("text=Read aloud there").wait_for()
    assert await own.count() == 1, "the robot's own words about it are no second line"
    await hold(page, "w", lambda: any(command.linear > 0 for _, command in site.applied[before:]))
    await page.keyboard.up("w")
    await screen.click("text=One moment, please")
    await page.wait_for_selector("#talk-list >> text=One moment, please")
    await kept(page, "talking")
    await kept(screen, "screen-messages")

    # The head, by key and by slider.
    await page.focus("#viewport")
    await page.keyboard.press("f")
    await until(lambda: abs(site.tilt - 0.1) < 1e-6)
    await page.evaluate(
        "() => { const s = document.querySelector('#tilt-slider'); s.value = '-0.3';"
        " s.dispatchEvent(new Event('input')); }"
    )
    await until(lambda: abs(site.tilt + 0.3) < 1e-6)

    # A screen that is shown takes the camera's place, whole.
    await page.click("#presence-volumes")
    await page.click("#presence-share")
    await page.wait_for_selector("text=They can see your screen.")
    await screen.wait_for_selector("#video[data-whole]")

    # Hanging up on the screen turns the visitor's camera off, and driving goes on.
    await screen.click("#hang-up")
    await page.wait_for_selector("text=They'd rather not talk now. You can keep driving.")
    assert await page.evaluate("() => document.querySelector('#self').srcObject") is None
    await screen.wait_for_selector("#face[data-scene=visiting]")


@pytest_asyncio.fixture(loop_scope="module")
async def silent_browser(browser) -> AsyncIterator[Browser]:
    """A browser that plays no sound before a touch, as everywhere but in tests."""
    args = [*FLAGS, "--autoplay-policy=document-user-activation-required"]
    started = await browser.browser_type.launch(executable_path=CHROMIUM, args=args)
    yield started
    await started.close()


async def test_page_says_what_the_people_at_the_robot_get_of_the_visitor(
    opened, silent_browser
) -> None:
    with PresentRobotPage(devices=False) as site:
        page = await drives(opened, site, permissions=["microphone", "camera"])
        await page.click("#presence-mic")
        await page.wait_for_selector("text=The robot's screen is off: nobody can see or hear you.")

        screen = await silent_browser.new_page(viewport={"width": 1280, "height": 800})
        await screen.goto(site.screen_url)
        await page.wait_for_selector("text=Their sound is off: they can't hear you.")
        await screen.wait_for_selector("text=Tap the screen to hear them.")
        await kept(page, "their-sound-is-off")
        await kept(screen, "screen-silent")
        await screen.click("#title")
        await page.wait_for_selector("text=They can hear you.")
        await screen.wait_for_selector("text=You can hear them.")
        await page.click("#presence-camera")
        await page.wait_for_selector("text=They can see and hear you.")
        await screen.fill("#volume", "0")
        await page.wait_for_selector("text=Their sound is off: they can't hear you.")

        # Its page is closed during the call.
        await screen.close()
        await page.wait_for_selector("text=The robot's screen is off: nobody can see or hear you.")
        assert not await page.is_visible("text=They can")


async def write(page: Page, text: str, *, aloud: bool = False):
    """Write a message, and return its line in the list."""
    if not await page.is_visible("#talk-writing"):
        await page.click("#presence-talk")
    await page.set_checked("#talk-aloud", aloud)
    await page.fill("#talk-field", text)
    await page.press("#talk-field", "Enter")
    return page.locator("#talk-list .line--own", has_text=text)


@pytest.mark.nightly
async def test_message_shows_how_far_it_was_delivered(opened, site) -> None:
    page = await drives(opened, site)

    # Without a screen the robot has it, unread.
    unseen = await write(page, "Is anybody there?")
    await unseen.locator("text=Sent, but the robot's screen is off.").wait_for()

    # Without a connection it counts as not sent, and the next press sends it once.
    site.loses_words = True
    lost = await write(page, "Hello again")
    await lost.locator("text=Not sent").wait_for()
    screen = await opened(site.screen_url)
    await screen.wait_for_selector("#face[data-scene=visiting][data-live]")
    site.loses_words = False
    await kept(page, "message-not-sent")
    await lost.locator("text=Send again").click()
    await lost.locator("text=Shown on the robot's screen").wait_for()
    assert await screen.locator("#messages .line").all_text_contents() == ["Ana Hello again"]

    # The screen has no voice, or is silent.
    await screen.evaluate("() => { document.querySelector('#volume').value = '0'; }")
    silent = await write(page, "Read this, please", aloud=True)
    await silent.locator("text=Shown there, but not read aloud").wait_for()
    results = await Axe().run(page)
    assert results.violations_count == 0, results.generate_report()
    await kept(page, "message-states")


KNOCKS = """() => {
  globalThis.notes = [];
  const start = OscillatorNode.prototype.start;
  OscillatorNode.prototype.start = function (...when) {
    notes.push(this.frequency.value);
    return start.apply(this, when);
  };
}"""


@pytest.mark.nightly
async def test_knock_rings_at_the_screen_until_it_is_answered(opened, site) -> None:
    page = await drives(opened, site)

    # Without a screen: the robot's own loudspeaker.
    await page.click("#presence-knock")
    await until(lambda: site.speaker.played > 60_000)
    await page.wait_for_selector("text=You knocked. Waiting for someone to answer.")
    await page.click("#presence-knock")
    await page.wait_for_selector("text=You just knocked. Wait a moment.")

    # A screen rings, is seen, and answers.
    site.calls.knock_pause = 0.0
    screen = await opened(site.screen_url)
    await screen.wait_for_selector("#face[data-scene=visiting][data-live]")
    await screen.click("#title")  # before a click a browser plays nothing
    await screen.evaluate(KNOCKS)
    await page.click("#presence-knock")
    await screen.wait_for_selector("#knock-text >> text=Ana is knocking")
    notes = await evaluated(screen, "() => notes", lambda found: len(found) == 4)
    assert notes == pytest.approx([659.25, 1318.5, 523.25, 1046.5])
    results = await Axe().run(screen)
    assert results.violations_count == 0, results.generate_report()
    await kept(screen, "screen-knock")
    await screen.click("#knock-accept")
    await screen.wait_for_selector("#knock", state="hidden")
    await page.wait_for_selector("text=Someone answered your knock.")
    assert await screen.evaluate("notes.length") == 4, "it rings once"

    # Not now: it stays quiet, and so does the button.
    await page.click("#presence-knock")
    await screen.wait_for_selector("#knock:not([hidden])")
    await screen.click("#knock-decline")
    await page.wait_for_selector("text=They'd rather not talk now. You can keep driving.")
    await page.wait_for_selector("#presence-knock", state="hidden")
    await kept(page, "knock-declined")


async def test_screen_accepts_calls_where_required_and_stops_the_robot(opened, site) -> None:
    site.calls.rule = "ask"
    site.is_study = True
    screen = await opened(site.screen_url)
    await screen.wait_for_selector("text=I am Giraff")
    page = await drives(opened, site, permissions=["microphone", "camera"])
    await screen.wait_for_selector("text=A study is in progress.")
    await kept(screen, "screen-study")
    await page.click("#presence-camera")
    await screen.wait_for_selector("text=Ana would like to talk to you")
    await page.wait_for_selector("text=Ringing. Nobody can see or hear you yet.")
    await kept(page, "ringing")
    await kept(screen, "screen-rings")
    assert site.media.visitor.counts.get("video", 0) == 0
    await screen.click("#accept")
    await screen.wait_for_selector("#face[data-scene=seen]")
    assert is_green(await evaluated(screen, COLOUR, is_green))
    await screen.click("#stop")
    await until(lambda: site.kernel.latch is not None)
    assert site.kernel.latch.source == "screen"
    await screen.wait_for_selector("text=Stopped from this display.")
    await kept(screen, "screen-stopped")
    assert await screen.is_hidden("#stop"), "the button to release it is in its place"
    for press in ("#release", "#release-not", "#release"):
        await screen.click(press)
        assert site.kernel.latch is not None, "one press too many does not release it"
    await screen.click("#release-sure")
    await until(lambda: site.kernel.latch is None)
    site.end("completed")
    await screen.wait_for_selector("text=Nobody is visiting now.")
    await kept(screen, "screen-left")
    await page.wait_for_selector("#presence", state="hidden")
    camera = await page.evaluate("() => document.querySelector('#self').srcObject")
    assert camera is None, "the camera is off"


async def test_screen_page_provides_camera_and_microphone_of_the_robot(opened) -> None:
    with PresentRobotPage(from_page=True) as site:
        await opened(site.screen_url)
        ana = await drives(opened, site)
        await evaluated(ana, COLOUR, is_green)
        await until(lambda: site.media.camera.status == site.media.microphone.status == "live")
        assert (await asyncio.to_thread(site.media.snapshot)).width >= 320


# The picture of a video on the page, without the bars beside it, in CSS pixels.
PICTURE = """const pictureOf = (video) => {
  const box = video.getBoundingClientRect();
  const scale = Math.min(box.width / video.videoWidth, box.height / video.videoHeight);
  const [width, height] = [scale * video.videoWidth, scale * video.videoHeight];
  const [left, top] = [box.left + (box.width - width) / 2, box.top + (box.height - height) / 2];
  return { left, top, width, height };
};"""
# The middle of a dot, in shares of the picture; null without a dot.
SPOT = f"""([video, dot]) => {{
  {PICTURE}
  const element = document.querySelector(dot);
  if (!element.hasAttribute("data-on")) return null;
  const picture = pictureOf(document.querySelector(video));
  const spot = element.getBoundingClientRect();
  return [
    (spot.left + spot.width / 2 - picture.left) / picture.width,
    (spot.top + spot.height / 2 - picture.top) / picture.height,
  ];
}}"""
PLACE = f"""([video, [x, y]]) => {{
  {PICTURE}
  const picture = pictureOf(document.querySelector(video));
  return [picture.left + x * picture.width, picture.top + y * picture.height];
}}"""
# The difference between the sizes of the dots' layer and of the picture beneath.
LAID = f"""() => {{
  {PICTURE}
  const picture = pictureOf(document.querySelector("#shared-video"));
  const layer = document.querySelector("#shared-pointers").getBoundingClientRect();
  return Math.abs(layer.width - picture.width) + Math.abs(layer.height - picture.height);
}}"""
NEAR = 0.02  # of the picture
SMALL, LARGE = "#shared-video", "#video"
LAYERS = {SMALL: "#shared-pointers", LARGE: "#pointers"}


async def place(page: Page, video: str, at: tuple[float, float]) -> tuple[float, float]:
    """Return where a spot of a picture is on the page, in CSS pixels."""
    return tuple(await page.evaluate(PLACE, [video, at]))


async def point(
    page: Page, video: str, side: str, at: tuple[float, float], *others: tuple[Page, str]
) -> None:
    """Move the mouse near a spot of a picture until the dot of a side is there on all pages."""
    for step in range(int(patient(15) / 0.1)):
        # measured each time, as a page that has changed its size may still move things
        x, y = await place(page, video, at)
        await page.mouse.move(x + step % 2, y)
        await asyncio.sleep(0.1)
        found = [
            await one.evaluate(SPOT, [over, f"{LAYERS[over]} .remote-pointer--{side}"])
            for one, over in ((page, video), *others)
        ]
        if all(spot and max(abs(spot[0] - at[0]), abs(spot[1] - at[1])) < NEAR for spot in found):
            return
    raise AssertionError(f"no dot at {at}; the last were {found}")


async def no_dot(page: Page, side: str) -> None:
    await page.wait_for_selector(
        f".remote-pointer--{side}:not([data-on])", state="attached", timeout=patient(15) * 1000
    )


async def faults(page: Page) -> list[str]:
    """Return what axe-core finds."""
    return [
        f"{found['id']}: {found['nodes'][0]['html'][:120]}"
        for found in (await Axe().run(page)).response["violations"]
    ]


async def shown(opened: Open, site: PresentRobotPage, **context: Any) -> tuple[Page, Page]:
    """Return the drive page and the robot's display, once a screen is shared and both can point."""
    screen = await opened(site.screen_url)
    await screen.wait_for_selector("#face[data-live]")
    page = await drives(opened, site, **context)
    await page.click("#presence-volumes")
    await page.click("#presence-share")
    await page.wait_for_selector("text=They can see your screen.")
    await page.click("#presence-volumes")
    await page.wait_for_selector("#shared-pointers[data-open]", timeout=patient(15) * 1000)
    await screen.wait_for_selector("#pointers[data-open]", timeout=patient(15) * 1000)
    for one, video in ((page, SMALL), (screen, LARGE)):
        await evaluated(
            one, f"() => document.querySelector('{video}').videoWidth", lambda width: width > 0
        )
    return page, screen


@pytest.mark.nightly
async def test_dots_of_both_sides_are_at_the_same_place_on_both_pages(opened, site) -> None:
    page, screen = await shown(opened, site)
    assert await page.get_attribute("#shared", "hidden") is None
    style = "() => getComputedStyle(document.querySelector('#video')).objectFit"
    assert await screen.evaluate(style) == "contain"
    before = len(site.applied)

    # Moving the mouse over the small picture never drives; a resting mouse shows no dot.
    for at in [(0.25, 0.7), (0.9, 0.1)]:
        await point(page, SMALL, "driver", at, (screen, LARGE))
    assert (
        await screen.text_content("#pointers .remote-pointer--driver")
        == await page.text_content("#shared-pointers .remote-pointer--driver")
        == "A"
    )
    await no_dot(screen, "driver")
    await no_dot(page, "driver")

    # A dot stays while the button is held, and disappears when the mouse leaves.
    at = (0.4, 0.5)
    await page.mouse.move(*await place(page, SMALL, at))
    await page.mouse.down()
    await point(page, SMALL, "driver", at, (screen, LARGE))
    sent = len(site.pointed)
    await until(lambda: len(site.pointed) >= sent + 3, 15)

    # At the same time a press on the display shows another dot, a ring.
    there = (0.7, 0.3)
    await screen.mouse.move(*await place(screen, LARGE, there))
    await screen.mouse.down()
    await point(screen, LARGE, "screen", there, (page, SMALL))
    await kept(page, "pointing")
    await kept(screen, "screen-pointing")
    assert await faults(page) == await faults(screen) == []
    await screen.mouse.up()
    await page.mouse.up()
    assert await page.evaluate("() => document.activeElement.id") == "viewport"
    await page.mouse.move(*await place(page, "#viewport video", (0.5, 0.2)))
    for one in (page, screen):
        for side in ("driver", "screen"):
            await no_dot(one, side)
    assert "datachannel" in {transport for transport, _ in site.pointed}
    assert site.pointed[-1][1].at is None
    assert all(command.linear == command.angular == 0.0 for _, command in site.applied[before:])
    assert site.asked[-1].shares is True


@pytest.mark.nightly
async def test_dots_ignore_bars_and_pass_through_the_server_if_needed(opened, site) -> None:
    page, screen = await shown(opened, site)
    before, counted = len(site.applied), len(site.pointed)
    box = await screen.locator("#video").bounding_box()
    await screen.mouse.click(box["x"] + box["width"] / 2, box["y"] + 5)
    await point(page, SMALL, "driver", (0.5, 0.5), (screen, LARGE))
    assert {dot.by for _, dot in site.pointed[counted:]} == {"driver"}
    await hold(page, "w", lambda: any(command.linear > 0 for _, command in site.applied[before:]))
    await page.keyboard.up("w")

    # Without a data channel dots pass through the server.
    site.deaf_to_channel = True
    counted = len(site.pointed)
    await point(page, SMALL, "driver", (0.2, 0.2), (screen, LARGE))
    assert {transport for transport, _ in site.pointed[counted:]} == {"mqtt"}
    site.deaf_to_channel = False

    # Without a shared screen there is nothing to point at.
    await page.click("#presence-hang-up")
    await page.wait_for_selector("#shared", state="hidden")
    await screen.wait_for_selector("#pointers:not([data-open])", state="attached")


@pytest.mark.parametrize("size", [(1280, 800), (1024, 560), (390, 844), (844, 390)])
async def test_preview_covers_neither_the_floor_ahead_nor_any_control(opened, site, size) -> None:
    page, _ = await shown(opened, site, reduced_motion="reduce")
    await page.set_viewport_size({"width": size[0], "height": size[1]})
    await evaluated(page, LAID, lambda apart: apart < 1.0)
    at = (0.75, 0.25)
    await point(page, SMALL, "driver", at)
    await kept(page, f"pointing-{size[0]}")
    preview = await page.locator("#shared").bounding_box()
    stage = await page.locator("#viewport").bounding_box()
    assert preview["width"] >= 90, "enough to point at"
    middle = stage["y"] + stage["height"] / 2
    assert preview["y"] + preview["height"] <= middle, "it covers the floor ahead"
    assert preview["x"] >= stage["x"] + stage["width"] / 2
    for selector in ("#stop", ".presence__bar", "#presence-note", "#tilt", "#map-panel", "#alert"):
        other = await page.locator(selector).bounding_box()
        apart = other is None or any(
            other[axis] >= preview[axis] + preview[size]
            or other[axis] + other[size] <= preview[axis]
            for axis, size in (("x", "width"), ("y", "height"))
        )
        assert apart, f"it covers {selector}"
    assert await faults(page) == []


@pytest.mark.nightly
async def test_missing_camera_or_microphone_has_a_next_step(opened, site) -> None:
    page = await drives(opened, site)
    for kind, name, sentence in [
        ("mic", "NotFoundError", "No microphone found. Plug one in and try again, or send"),
        (
            "camera",
            "NotAllowedError",
            "Your browser blocks the camera. Allow it next to the page's",
        ),
        ("camera", "NotReadableError", "Another program is using the camera. Close it and try"),
    ]:
        reject = f"Promise.reject(new DOMException('no', '{name}'))"
        await page.evaluate(f"() => {{ navigator.mediaDevices.getUserMedia = () => {reject}; }}")
        await page.click(f"#presence-{kind}")
        await page.wait_for_selector(f"#presence-note[data-trouble] >> text={sentence}")
        assert await page.is_visible("#presence-again")
        assert await page.is_visible("#presence-where") == (name == "NotAllowedError")
        before = len(site.applied)
        await hold(page, "ArrowUp", lambda before=before: len(site.applied) > before + 3)
        await page.keyboard.up("ArrowUp")
        await page.click("#presence-dismiss")
        await page.wait_for_selector("#presence-note", state="hidden")
    assert site.asked == []


async def test_photo_is_taken_shown_and_saved(opened, site) -> None:
    page = await drives(opened, site)
    await page.click("#presence-photo")
    photo = await until(lambda: next((one for one in site.asked if isinstance(one, m.Photo)), None))
    site.photos[photo.action_id] = (ROOT / "static/img/screens/drive-wide.webp").read_bytes()
    await page.wait_for_selector("#kept-download:not([hidden])")
    assert await page.get_attribute("#kept-download", "download") == "giraff.jpg"
    await page.click("#kept-close")
    await page.wait_for_selector("#kept", state="hidden")
