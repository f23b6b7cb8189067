"""Voice, face and words between a visitor's browser and a robot's own display, both real Chromiums, measured at the far ends."""

import asyncio
import math
import struct
import wave
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from playwright.async_api import Browser, Page, async_playwright

from robots.api import messages as m
from tests.browser.test_drive_page_alone import driving, hold, until
from tests.support.browser_page import CHROMIUM, FLAGS
from tests.support.patience import patient
from tests.support.photographs import kept
from tests.support.present_robot_page import PresentRobotPage

pytestmark = pytest.mark.browser
HERTZ = 880.0
FAKE = ["--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream", "--auto-select-tab-capture-source-by-title=Giraff"]
# Chromium's fake camera is green all over, but for a pie and a counter.
COLOUR = """() => {
  const video = document.querySelector("#video");
  if (!video.videoWidth) return null;
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 16;
  const brush = canvas.getContext("2d");
  brush.drawImage(video, 0, 0, 16, 16);
  const data = brush.getImageData(0, 0, 16, 16).data;
  const mean = [0, 1, 2].map((part) => data.filter((_, at) => at % 4 === part).reduce((sum, value) => sum + value, 0) / 256);
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
    """Write ten seconds of a sine, which Chromium's fake microphone plays again and again."""
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(48_000)
        file.writeframes(b"".join(struct.pack("<h", int(12_000 * math.sin(2 * math.pi * HERTZ * n / 48_000))) for n in range(480_000)))
    return path


@pytest.fixture
async def chromium(tmp_path) -> AsyncIterator[Browser]:
    async with async_playwright() as playwright:
        flags = [*FLAGS, *FAKE, f"--use-file-for-fake-audio-capture={tone(tmp_path / 'tone.wav')}"]
        browser = await playwright.chromium.launch(executable_path=CHROMIUM, headless=True, args=flags)
        yield browser
        await browser.close()


async def opened(browser: Browser, address: str, complaints: list[str], **context) -> Page:
    page = await (await browser.new_context(viewport={"width": 1280, "height": 800}, **context)).new_page()
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda line: complaints.append(line.text) if line.type == "error" else None)
    await page.goto(address)
    return page


async def drives(browser: Browser, site: PresentRobotPage, complaints: list[str], **context) -> Page:
    page = await opened(browser, site.url, complaints, **context)
    await page.click("text=Drive Giraff")
    await driving(page)
    return page


async def evaluated(page: Page, script: str, good, seconds: float = 15.0):
    """Poll a script until `good` likes what it gives."""
    for _ in range(int(patient(seconds) / 0.1)):
        found = await page.evaluate(script)
        if found is not None and good(found):
            return found
        await asyncio.sleep(0.1)
    raise AssertionError(f"nothing of the kind; the last was {found}")


def is_green(colour) -> bool:
    red, green, blue = colour
    return green > 60 and green > red + 30 and green > blue + 30


async def test_voice_and_face_reach_the_robots_loudspeaker_and_its_screen_and_words_go_both_ways(chromium, site) -> None:
    complaints: list[str] = []
    page = await drives(chromium, site, complaints, permissions=["microphone", "camera"])
    assert site.speaker.played == 0, "nothing is sent before a click"

    # The robot's own outputs, while it has no screen.
    await page.click("#presence-mic")
    await page.click("#presence-camera")
    await until(lambda: abs(site.speaker.tone - HERTZ) < 15 and site.speaker.level > 0.02, 15)
    await until(lambda: site.display.colour and is_green(site.display.colour), 15)
    await page.wait_for_selector("#presence-note[data-sending] >> text=They see and hear you.")

    # Its screen, which takes over.
    screen = await opened(chromium, site.screen_url, complaints)
    await screen.wait_for_selector("#face[data-scene=seen][data-live]")
    assert is_green(await evaluated(screen, COLOUR, is_green))
    heard = await evaluated(screen, TONE, lambda found: abs(found["hertz"] - HERTZ) < 15 and found["level"] > -60)
    assert abs(heard["hertz"] - HERTZ) < 15
    assert await screen.text_content("#name-text") == "Ana is visiting"

    # And the other way: the robot's sound and picture are here.
    assert await page.evaluate("() => document.querySelector('#video').videoWidth") > 0
    await evaluated(page, TONE, lambda found: found["level"] > -80)

    # Muted: not heard, but while T is down.
    await page.click("#presence-mic")
    await evaluated(screen, TONE, lambda found: found["level"] < -90)
    await page.keyboard.down("t")
    await evaluated(screen, TONE, lambda found: abs(found["hertz"] - HERTZ) < 15 and found["level"] > -60)
    await page.keyboard.up("t")
    await page.wait_for_selector("text=They see you and do not hear you. Hold T to talk.")

    # Words, which never drive; afterwards the keys do.
    await screen.evaluate("() => { globalThis.spoken = []; speechSynthesis.speak = (one) => spoken.push([one.text, one.lang]); }")
    before = len(site.applied)
    await page.click("#presence-talk")
    await page.check("#talk-aloud")
    await page.fill("#talk-field", "")
    await page.type("#talk-field", "was hello wasd")
    assert len(site.applied) == before
    await page.press("#talk-field", "Enter")
    await screen.wait_for_selector("#messages >> text=was hello wasd")
    assert await screen.evaluate("spoken") == [["was hello wasd", "en"]]
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
    await page.evaluate("() => { const s = document.querySelector('#tilt-slider'); s.value = '-0.3'; s.dispatchEvent(new Event('input')); }")
    await until(lambda: abs(site.tilt + 0.3) < 1e-6)

    # A screen that is shown takes the camera's place, whole.
    await page.click("#presence-volumes")
    await page.click("#presence-share")
    await page.wait_for_selector("text=They see your screen.")
    await screen.wait_for_selector("#video[data-whole]")

    # Hanging up there ends it here: the camera is given back, and driving goes on.
    await screen.click("#hang-up")
    await page.wait_for_selector("text=They would rather not talk now. You can go on driving.")
    assert await page.evaluate("() => document.querySelector('#self').srcObject") is None
    await screen.wait_for_selector("#face[data-scene=visiting]")
    assert complaints == []


async def test_the_screen_answers_first_where_the_owner_wants_it_and_stops_the_robot(chromium, site) -> None:
    complaints: list[str] = []
    site.calls.rule = "ask"
    site.is_study = True
    screen = await opened(chromium, site.screen_url, complaints)
    await screen.wait_for_selector("text=I am Giraff")
    page = await drives(chromium, site, complaints, permissions=["microphone", "camera"])
    await screen.wait_for_selector("text=A study is under way.")
    await kept(screen, "screen-study")
    await page.click("#presence-camera")
    await screen.wait_for_selector("text=Ana would like to talk to you")
    await page.wait_for_selector("text=It rings there. Nobody sees or hears you yet.")
    await kept(page, "ringing")
    await kept(screen, "screen-rings")
    assert site.media.visitor_counts.get("video", 0) == 0
    await screen.click("#accept")
    await screen.wait_for_selector("#face[data-scene=seen]")
    assert is_green(await evaluated(screen, COLOUR, is_green))
    await screen.click("#stop")
    await until(lambda: site.kernel.latch is not None)
    assert site.kernel.latch.source == "screen", "on whichever way the stop came first"
    await screen.wait_for_selector("text=Stopped here.")
    await kept(screen, "screen-stopped")
    await screen.click("#release")
    await until(lambda: site.kernel.latch is None)
    site.end("completed")
    await screen.wait_for_selector("text=Nobody is visiting now.")
    await kept(screen, "screen-left")
    await page.wait_for_selector("#presence", state="hidden")
    assert await page.evaluate("() => document.querySelector('#self').srcObject") is None, "the camera is given back"
    assert complaints == []


async def test_the_robots_own_page_gives_picture_and_sound_where_the_robot_has_none(chromium) -> None:
    complaints: list[str] = []
    with PresentRobotPage(from_page=True) as site:
        await opened(chromium, site.screen_url, complaints)
        ana = await drives(chromium, site, complaints)
        await evaluated(ana, COLOUR, is_green)
        await until(lambda: site.media.camera.status == site.media.microphone.status == "live")
        assert (await asyncio.to_thread(site.media.snapshot)).width >= 320
    assert complaints == []


@pytest.fixture
async def refusing() -> AsyncIterator[Browser]:
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=CHROMIUM, headless=True, args=FLAGS)
        yield browser
        await browser.close()


async def test_without_camera_or_microphone_there_is_a_next_step_and_driving_goes_on(refusing, site) -> None:
    complaints: list[str] = []
    page = await drives(refusing, site, complaints)
    # A computer without a microphone; then one whose owner has said no.
    for kind, name, sentence in [
        ("mic", "NotFoundError", "No microphone was found. Plug one in and ask again, or write to them."),
        ("camera", "NotAllowedError", "Your browser keeps the camera. Allow it beside the page's address. You can go on driving."),
        ("camera", "NotReadableError", "Another program uses the camera. Close it and ask again, or go on without."),
    ]:
        await page.evaluate(f"() => {{ navigator.mediaDevices.getUserMedia = () => Promise.reject(new DOMException('no', '{name}')); }}")
        await page.click(f"#presence-{kind}")
        await page.wait_for_selector(f"#presence-note[data-trouble] >> text={sentence}")
        assert await page.is_visible("#presence-again")
        assert await page.is_visible("#presence-where") == (name == "NotAllowedError")
        assert await drives_on(page, site)
        await page.click("#presence-dismiss")
        await page.wait_for_selector("#presence-note", state="hidden")
    assert site.asked == []
    assert complaints == []


async def drives_on(page: Page, site: PresentRobotPage) -> bool:
    """Press a key, and again: a page that was held up for a moment lets go of a key, as it should, and people press again."""
    before = len(site.applied)
    for _ in range(20):
        await page.keyboard.down("ArrowUp")
        await asyncio.sleep(0.5)
        await page.keyboard.up("ArrowUp")
        if any(command.linear > 0 for _, command in site.applied[before:]):
            return True
    return False


async def test_a_photo_is_taken_shown_and_kept(refusing, site) -> None:
    complaints: list[str] = []
    page = await drives(refusing, site, complaints)
    await page.click("#presence-photo")
    photo = await until(lambda: next((one for one in site.asked if isinstance(one, m.Photo)), None))
    site.photos[photo.action_id] = (Path(__file__).parents[2] / "static/img/screens/drive-wide.webp").read_bytes()
    await page.wait_for_selector("#kept-download:not([hidden])")
    assert await page.get_attribute("#kept-download", "download") == "giraff.jpg"
    await page.click("#kept-close")
    await page.wait_for_selector("#kept", state="hidden")
    assert complaints == []
