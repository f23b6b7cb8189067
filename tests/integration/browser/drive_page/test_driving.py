"""The drive page in a real Chromium, with a robot that can be cut off and muted."""

import functools
import time

import pytest

from robots.api.messages import VelocityCommand
from sessions import protocol
from tests.support.browsers.drive_page import (
    LOW,
    UPRIGHT,
    WIDE,
    driven,
    driving,
    hold,
    opened,
    stands,
    stops,
)
from tests.support.patience import until

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]
# why a robot refuses delayed commands, and those overtaken on the other transport
HELD_UP = {"stale", "frame_stale", "old_seq"}


def direct(site) -> int:
    """Return how many commands arrived on the data channel."""
    return [transport for transport, _ in site.applied].count("datachannel")


def offers(site) -> int:
    """Return how many connections pages have offered."""
    return len([signal for signal in site.received("signal") if hasattr(signal, "sdp")])


async def test_one_click_shows_video_and_a_held_key_drives_over_the_data_channel(browser, site):
    async with opened(browser, site) as page:
        await page.click("text=Drive Giraff")
        await driving(page)
        before = site.simulation.pose
        moved = lambda: site.simulation.pose.distance(before)
        await hold(page, "ArrowUp", lambda: direct(site) >= 12 and moved() > 0.02)
        await page.keyboard.up("ArrowUp")
        await until(lambda: stands(site))
        numbers = [command.seq for _, command in site.applied]
        assert numbers == sorted(set(numbers))
        assert set(site.refused) <= {"clock_unknown", *HELD_UP}
        late = sum(site.refused[reason] for reason in HELD_UP)
        assert late < len(site.applied), "late for a while, not for most of the drive"


async def test_key_held_during_a_fault_must_be_released_before_driving_on(site, page):
    for _ in range(2):
        await hold(page, "ArrowLeft", lambda: site.simulation.motion.angular > 0.1)
        site.do(site.kernel.set_fault, "the base is silent")
        await until(lambda: site.simulation.motion.angular == 0.0)
        site.do(lambda: site.kernel.clear_fault(time.monotonic()))
        await page.wait_for_selector("#alert[data-word='stuck.held']")
        said = await page.inner_text("#alert")
        assert said == "The robot was stopped. Release the controls, then drive on."
        await page.keyboard.up("ArrowLeft")
        await page.wait_for_selector("#alert[hidden]", state="attached")


@pytest.mark.nightly
@pytest.mark.parametrize(
    "missing", ["**/js/protocol/peer.*.js", "**/js/drive/page.*.js", "**/css/drive.*.css"]
)
async def test_page_reloads_itself_when_a_part_did_not_arrive(browser, site, missing):
    page = await (await browser.new_context()).new_page()
    await page.route(missing, lambda route: route.abort("connectionreset"), times=2)
    await page.goto(site.url)
    await page.click("text=Drive Giraff")
    await driving(page)


@pytest.mark.nightly
async def test_page_that_cannot_be_loaded_offers_to_try_again(browser, site):
    page = await (await browser.new_context()).new_page()
    await page.route("**/js/protocol/peer.*.js", lambda route: route.abort("connectionreset"))
    await page.goto(site.url)
    again = page.get_by_role("button", name="Reload")
    await again.wait_for(timeout=40_000)
    await page.unroute("**/js/protocol/peer.*.js")
    await again.click()
    await page.click("text=Drive Giraff")
    await driving(page)


@pytest.mark.nightly
async def test_command_names_the_frame_that_the_visitor_saw(browser, site):
    def with_picture() -> list[VelocityCommand]:
        return [command for _, command in list(site.applied) if command.frame is not None]

    async with driven(browser, site) as page:
        # Frames may be late for a while, and are never from the future.
        fresh = lambda: [one for one in with_picture() if one.stamp - one.frame < 1.0]
        commands = await hold(page, "KeyW", lambda: fresh()[3:])
        now = time.time()
        await page.keyboard.up("KeyW")
        assert all(now - command.frame > -0.05 for command in commands)
        assert all(command.frame < command.stamp for command in with_picture())


@pytest.mark.nightly
async def test_marker_on_the_map_is_where_the_robot_is(site, page):
    await page.wait_for_selector("#map[data-marker-x]")
    seen = await page.evaluate("""() => {
            const canvas = document.getElementById("map");
            const { markerX, markerY, viewX, viewY, viewScale } = canvas.dataset;
            const density = canvas.width / canvas.clientWidth;
            const [left, top] = [markerX * density, markerY * density].map(Math.round);
            const pixel = canvas.getContext("2d").getImageData(left, top, 1, 1).data;
            const x = +viewX + (markerX - canvas.clientWidth / 2) / viewScale;
            const y = +viewY - (markerY - canvas.clientHeight / 2) / viewScale;
            return { x, y, pixel: Array.from(pixel) };
        }""")
    truth = site.simulation.pose
    assert abs(seen["x"] - truth.x) < 0.15
    assert abs(seen["y"] - truth.y) < 0.15
    assert seen["pixel"] == [0xFF, 0x8A, 0x3C, 255]


async def test_stop_button_stops_on_both_transports_despite_a_held_key(site, page):
    await hold(page, "ArrowUp", lambda: len(site.applied) > 5)
    await page.click("#stop")
    await until(lambda: stops(site, "datachannel") and stops(site, "mqtt"))
    last = site.applied[-1][1].seq
    stop = stops(site)[0]
    assert stop.seq > last
    await until(lambda: site.simulation.motion.linear == 0.0)
    await page.wait_for_selector("#stop:not([data-pending])")
    count = len(site.applied)
    await page.keyboard.up("ArrowUp")
    await hold(page, "ArrowUp", lambda: len(site.applied) > count)
    assert site.applied[count][1].seq > stop.seq
    await page.keyboard.up("ArrowUp")


async def test_a_page_that_is_left_stops_the_robot_though_the_key_is_held(site, page):
    await hold(page, "ArrowUp", lambda: len(site.applied) > 5)
    await page.evaluate("window.dispatchEvent(new Event('pagehide'))")
    await until(lambda: stops(site, "datachannel"))
    await until(lambda: site.simulation.motion.linear == 0.0)
    assert site.applied[-1][1].seq < stops(site)[0].seq


async def test_drive_goes_on_without_the_server_and_resumes_on_the_same_link(site, page):
    site.closed_to_sockets = True
    site.cut_sockets()
    await page.wait_for_selector("#alert[data-word='alert.server_only']")
    count = len(site.applied)
    await page.keyboard.down("ArrowLeft")
    await until(lambda: len(site.applied) > count + 10)
    site.closed_to_sockets = False
    takes = await until(lambda: [take for take in site.received("session/take") if take.peer])
    await page.wait_for_selector("#alert[hidden]", state="attached")
    await page.keyboard.up("ArrowLeft")
    assert takes[0].session
    assert offers(site) == 1
    assert len({command.epoch for _, command in site.applied}) == 1


COLOURS = """() => {
    const canvas = document.getElementById("still");
    const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    const at = (i) => 4 * Math.floor((i / 300) * (pixels.length / 4));
    return new Set(Array.from({ length: 300 }, (_, i) => pixels[at(i)])).size;
}"""


@pytest.mark.nightly
async def test_silent_link_is_replaced_and_the_old_frame_is_marked(site, page):
    site.muted = True
    site.answers.clear()
    await page.wait_for_selector("#drive-page[data-frozen]")
    assert await page.inner_text("#alert") == "Reconnecting… the robot has stopped."
    assert await page.is_visible("#still")
    assert await page.evaluate(COLOURS) > 20
    site.muted = False
    site.answers.set()
    await driving(page)
    await page.wait_for_selector("#drive-page:not([data-frozen])")
    assert offers(site) >= 2
    count = len(site.applied)
    await hold(page, "ArrowLeft", lambda: len(site.applied) > count + 3)
    await page.keyboard.up("ArrowLeft")


async def test_commands_switch_transport_when_the_data_channel_fails(site, page):
    await hold(page, "ArrowLeft", lambda: direct(site) > 5)
    site.deaf_to_channel = True
    await until(lambda: site.applied[-1][0] == "mqtt")
    site.deaf_to_channel = False
    await until(lambda: site.applied[-1][0] == "datachannel")
    await page.keyboard.up("ArrowLeft")
    numbers = [command.seq for _, command in site.applied]
    assert numbers == sorted(set(numbers))


@pytest.mark.nightly
async def test_reloaded_page_returns_to_its_session(site, page):
    session = site.received("session/take") and site._lease.session
    await page.reload()
    await driving(page)
    take = site.received("session/take")[-1]
    assert (take.session, take.takeover, take.peer) == (session, True, None)
    assert "go=1" not in page.url


async def test_second_visitor_waits_in_the_queue_and_sees_the_video(browser, site):
    async with opened(browser, site, query="?go=1") as first, opened(browser, site) as second:
        await driving(first)
        await second.wait_for_selector("text=Ana is driving Giraff")
        await second.click("text=Wait for my turn")
        await second.wait_for_selector("text=You are next")
        playing = "#drive-page[data-playing][data-role=observer]"
        await second.wait_for_selector(playing, timeout=40_000)
        await second.keyboard.press("ArrowUp")
        # Observers can stop the robot, and the button looks enabled.
        looks = "e => [e.disabled, e.innerText.trim(), getComputedStyle(e).color]"
        enabled = await second.eval_on_selector("#stop", looks)
        assert enabled[:2] == [False, "Stop the robot"]
        # in one step: with the next frame the page enables it again
        off = "e => { e.disabled = true; return getComputedStyle(e).color; }"
        assert await second.eval_on_selector("#stop", off) != enabled[2]
        await first.wait_for_selector("#waiting:not([hidden])")
        assert site.received("command/velocity") == []


@pytest.mark.parametrize(
    ("language", "name", "title"),
    [
        ("en", "(participant)", "Participant is driving Giraff"),
        ("es", "(visitor)", "Invitado está conduciendo Giraff"),
        ("es", "Guest", "Guest está conduciendo Giraff"),
    ],
)
async def test_unnamed_driver_is_named_in_the_observers_language(
    browser, site, monkeypatch, language, name, title
):
    monkeypatch.setattr(site, "html", functools.partial(site.html, language))
    async with opened(browser, site) as page:
        await page.wait_for_selector("#card-main:not([hidden])")
        site.tell("room", protocol.RoomState(driver=name, driving=True))
        await page.wait_for_selector(f"text={title}")


@pytest.mark.parametrize(
    ("outcome", "title"),
    [
        ("timed_out", "Your time is up"),
        ("robot_fault", "The robot has a problem"),
        ("moved", "You are driving on another page now"),
    ],
)
async def test_every_end_says_what_happened_and_releases_the_robot(site, page, outcome, title):
    site.end(outcome)
    await page.wait_for_selector(f"#card-title:has-text('{title}')")
    assert await page.is_visible("#card-main")
    assert await page.is_disabled("#stop")
    await page.keyboard.down("ArrowUp")
    await page.keyboard.up("ArrowUp")
    assert site.received("command/velocity") == []


async def test_leaving_asks_first_and_ends_the_session(site, page):
    await page.click("#leave")
    await page.click("text=Keep driving")
    await page.click("#leave")
    await page.click("#card-main")
    await page.wait_for_selector("#card-title:has-text('You have left the robot')")
    await until(lambda: site.received("session/leave"))


@pytest.mark.nightly
async def test_offline_robot_is_announced_and_driving_resumes_when_it_is_back(site, page):
    site.online = False
    site.tell("robot", protocol.RobotPresence(online=False))
    await page.wait_for_selector("#alert[data-word='alert.robot_offline']")
    site.online = True
    site.tell("robot", protocol.RobotPresence(online=True))
    await page.wait_for_selector("#alert[hidden]", state="attached")
    await driving(page)


async def test_finger_on_the_stick_drives_and_a_lost_touch_stops(browser, site):
    async with driven(browser, site, UPRIGHT) as page:
        box = await page.locator("#stick").bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + 8
        touches = await page.context.new_cdp_session(page)
        start = {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]}
        await touches.send("Input.dispatchTouchEvent", start)
        await until(lambda: [c for _, c in site.applied if c.linear > 0.2 and c.method == "stick"])
        await touches.send("Input.dispatchTouchEvent", {"type": "touchCancel", "touchPoints": []})
        await until(lambda: stops(site))
        await until(lambda: site.simulation.motion.linear == 0.0)


SEEN = """() => {
    const { scrollWidth, scrollHeight } = document.documentElement;
    const over = [scrollWidth - innerWidth, scrollHeight - innerHeight];
    const box = document.getElementById("stop").getBoundingClientRect();
    const corners = [
      [box.left + 9, box.top + 9],
      [box.right - 9, box.bottom - 9],
      [(box.left + box.right) / 2, (box.top + box.bottom) / 2],
    ];
    const free = corners.every(([x, y]) => document.elementFromPoint(x, y)?.closest("#stop"));
    const small = [...document.querySelectorAll("button:not([hidden]), .bar a")]
      .filter((one) => one.offsetParent && one.getBoundingClientRect().height < 38)
      .map((one) => one.id || one.textContent.trim());
    const shown = [".speed__step", ".bar__button", ".button"].map((one) => one + ":not([hidden])");
    const outside = [...document.querySelectorAll([".stop", ".stage", ...shown].join(", "))]
      .filter((one) => one.offsetParent)
      .map((one) => [one.id || one.textContent.trim(), one.getBoundingClientRect()])
      .filter(([, r]) => r.left < -1 || r.top < -1
        || r.right > innerWidth + 1 || r.bottom > innerHeight + 1)
      .map(([name]) => name);
    return { over, free, small, outside };
}"""


@pytest.mark.parametrize("size", [WIDE, UPRIGHT, LOW], ids=["wide", "upright", "low"])
async def test_everything_is_in_reach_and_nothing_covers_the_stop_button(browser, site, size):
    async with opened(browser, site, size) as page:
        for step in ("lobby", "driving", "leaving", "ended"):
            if step == "lobby":
                await page.wait_for_selector("#card-main:visible")
            elif step == "driving":
                await page.click("#card-main")
                await driving(page)
            elif step == "leaving":
                await page.click("#leave")
                await page.wait_for_selector("#card-main:visible")
            else:
                site.end("timed_out")
                await page.click("#card-other")
                await page.wait_for_selector("#drive-page[data-phase=ended]")
            right = {"over": [0, 0], "free": True, "small": [], "outside": []}
            assert await page.evaluate(SEEN) == right, step


STOP_SIZES = """() => {
    const [page, assist] = ["drive-page", "assist"].map((id) => document.getElementById(id));
    const sizes = new Set();
    for (const phase of ["lobby", "taking", "queued", "turn", "driving", "watching", "ended"]) {
      for (const hidden of [false, true]) {
        page.dataset.phase = phase;
        assist.hidden = hidden;
        sizes.add(document.getElementById("stop").getBoundingClientRect().height);
      }
    }
    return [...sizes];
}"""


@pytest.mark.parametrize("size", [WIDE, UPRIGHT, LOW], ids=["wide", "upright", "low"])
async def test_stop_button_has_one_height_in_every_state(browser, site, size):
    async with opened(browser, site, size) as page:
        await page.wait_for_selector("#card-main:visible")
        sizes = await page.evaluate(STOP_SIZES)
        assert len(sizes) == 1, sizes
        assert sizes[0] >= 64, sizes


PLACES = """() => [
  "viewport", "video", "map-panel", "speed", "stop", "status", "leave"
].map((id) => {
    const { x, y, width, height } = document.getElementById(id).getBoundingClientRect();
    return [id, x, y, width, height];
})"""


async def test_layout_is_stable_when_the_video_starts(browser, site):
    site.answers.clear()
    async with opened(browser, site) as page:
        await page.click("#card-main")
        await page.wait_for_selector(
            "#drive-page[data-phase=driving]:not([data-playing]) #card[data-card=link]"
        )
        before = await page.evaluate(PLACES)
        site.answers.set()
        await driving(page)
        after = await page.evaluate(PLACES)
        # The status text changes, its position does not.
        assert [place[:3] for place in after] == [place[:3] for place in before]
        others = lambda places: [place for place in places if place[0] != "status"]
        assert others(after) == others(before)
