"""The media side against pages without a browser: real WebRTC on loopback."""

import asyncio
import contextlib
import gc
import random
import socket
import statistics
import time
from itertools import pairwise
from pathlib import Path

import pytest

from robots.agent.media.peers.connections import FLOOD_PAUSE
from robots.agent.media.rtp import RtpStream, capture_stamp
from robots.agent.media.webrtc import sender_queue, signalling
from robots.agent.media.webrtc.packet_gate import MAX_BYTES
from robots.api.codec import encode_frame
from robots.api.messages import (
    Bye,
    Candidate,
    CommandHeartbeat,
    Echo,
    Heartbeat,
    IceServer,
    PointCommand,
    Pointer,
    SdpOffer,
    Stay,
    Stop,
)
from tests.support import words
from tests.support.media.loopback_peer import MediaRig, until
from tests.support.media.synthetic_camera import TICKS_PER_SECOND, apart, code_of, read_code
from tests.support.media.transport_feedback import arrival

UNKNOWN = "candidate:1 1 udp 2113937151 9439dfa4-1278-4fc7-aa4d-2a5599e7885e.local 57459 typ host"


def step(before, after):
    """Return the RTP ticks between two pictures; timestamps start at random and wrap at 2^32."""
    return (after[0] - before[0] + (1 << 31)) % (1 << 32) - (1 << 31)


async def more(page, count=5, timeout=10.0):
    """Wait until a page has got so many more pictures."""
    seen = len(page.pictures)
    await until(lambda: len(page.pictures) > seen + count, timeout, "more pictures")


async def test_page_shows_the_camera_and_plays_the_microphone(media, connected):
    page = await connected("p1", decode=True)
    await until(lambda: len(page.images) > 5, what="decoded pictures")
    assert page.images[-1].shape == (480, 640, 3)
    assert page.images[-1].std() > 20
    assert read_code(page.images[-1]) is not None
    await until(lambda: page.sounds > 10, what="sounds")
    assert media.connected == 1
    assert media.camera.status == "live"


async def test_page_gets_the_capture_time_of_each_picture(connected):
    page = await connected("p1", decode=True)
    clock = await until(lambda: page.clocks() and page.clocks()[-1], what="a media clock")
    await until(lambda: len(page.images) > 10)
    newest = page.pictures[-1][0]
    assert abs(capture_stamp(clock, newest) - time.time()) < 1.0
    seen = read_code(page.images[-1])
    stamps = [code_of(capture_stamp(clock, rtp)) for rtp, _ in page.pictures]
    assert min(apart(seen, stamp) for stamp in stamps) <= 0.002 * TICKS_PER_SECOND


@pytest.mark.nightly
async def test_media_clock_is_sent_every_second(connected):
    page = await connected("p1")
    await until(lambda: len(page.clocks()) >= 6, what="six clocks")
    gaps = [after.stamp - before.stamp for before, after in pairwise(page.clocks()[:6])]
    assert 0.9 < statistics.median(gaps) < 1.5


async def test_all_viewers_get_the_pictures_of_one_encoder(connected):
    first = await connected("p1", decode=True)
    second = await connected("p2", decode=True)
    await until(lambda: len(second.pictures) > 10)
    common = {rtp for rtp, _ in first.pictures} & {rtp for rtp, _ in second.pictures}
    assert len(common) > 8


async def test_late_viewer_starts_with_a_key_frame_without_gap_for_others(
    media, new_page, monkeypatch
):
    # A computer that is late by 100 ms would empty a queue, too.
    monkeypatch.setattr(sender_queue, "DEPTH", 1000)
    first, late = new_page("p1"), new_page("p2")
    await first.connect()
    await until(lambda: len(first.pictures) > 20)
    await late.connect()
    await until(lambda: len(late.pictures) > 10)
    assert late.pictures[0][1], "the first picture is a key frame"
    # Counted, not timed, because a busy computer delays all pictures.
    shown = {rtp for rtp, _ in late.pictures[:10]}
    await until(lambda: shown <= {rtp for rtp, _ in first.pictures}, what="every picture of both")
    assert media._pages._viewers["p1"]._pictures.queue.restarts == 0


@pytest.mark.nightly
async def test_only_a_viewer_on_a_narrow_network_gets_smaller_pictures(media, connected):
    narrow = await connected("narrow", decode=True)
    wide = await connected("wide", decode=True)
    await until(lambda: narrow.images and wide.images)

    began = reported = time.monotonic()
    number = 0

    def crowd():
        """Report ten times a second, as a browser does, a packet that took longer and longer."""
        nonlocal reported, number
        if (now := time.monotonic()) - reported > 0.1:
            reported, number = now, number + 1
            late = min(3.0, 0.15 * number)
            dtls = narrow.connection.getTransceivers()[0].receiver.transport
            report = arrival(number, min(7.9, now - began + late))
            asyncio.ensure_future(dtls._send_rtp(report))  # noqa: RUF006
        return narrow.images[-1].shape[0] == 240

    await until(crowd, 20.0, "pictures of the lowest layer")
    seen = media.statistics()["wide"]["pictures"]
    await until(lambda: media.statistics()["wide"]["pictures"] > seen + 5)
    assert wide.images[-1].shape[0] == 480
    assert media.statistics()["narrow"]["layer"] > media.statistics()["wide"]["layer"]


async def test_lost_pictures_cause_few_key_frames(connected):
    page = await connected("p1")
    await until(lambda: len(page.pictures) > 15)
    before = len(page.pictures)
    began = time.monotonic()
    while time.monotonic() - began < 1.0:
        await page.lose_a_picture()
        count = len(page.pictures)
        await until(lambda count=count: len(page.pictures) > count)
    keys = sum(key for _, key in page.pictures[before:])
    assert 1 <= keys <= 1 + (time.monotonic() - began) / 0.3


async def test_slow_viewer_restarts_on_a_key_frame_without_affecting_others(media, connected):
    slow = await connected("slow")
    other = await connected("other")
    await until(lambda: len(slow.pictures) > 10)
    outbox = media._pages._viewers["slow"]._pictures
    backlog, outbox.backlog = outbox.backlog, lambda: 1_000_000
    restarts = outbox.queue.restarts
    await until(lambda: outbox.queue.restarts > restarts, what="a restart")
    held = len(slow.pictures)
    await more(other, 15)
    assert len(slow.pictures) <= held + 3, "pictures were sent into a full socket"
    resumed = len(slow.pictures)
    outbox.backlog = backlog
    await more(slow)
    assert slow.pictures[resumed][1], "not resumed with a key frame"


async def test_lost_packet_is_retransmitted_on_request(new_page):
    page = new_page("p1")
    packets: list = []
    receiver = page.video.receiver
    noted = receiver._handle_rtp_packet

    async def note(packet, arrival_time_ms):
        packets.append(packet)
        await noted(packet, arrival_time_ms)

    receiver._handle_rtp_packet = note
    await page.connect()
    lost = await until(lambda: len(packets) > 30 and packets[-10], what="packets")
    await receiver._send_rtcp_nack(page.ssrc, [lost.sequence_number])
    again = await until(
        lambda: [p for p in packets if p.ssrc != lost.ssrc], what="a retransmission"
    )
    assert int.from_bytes(again[0].payload[:2], "big") == lost.sequence_number
    assert again[0].payload[2:] == lost.payload


async def test_camera_runs_only_while_it_has_viewers(camera, media, connected):
    assert camera.starts == 0
    await connected("p1")
    await until(lambda: camera.running)
    media.signal("p1", Bye(reason="left"))
    await until(lambda: not camera.running, what="a stopped camera")
    assert (media.connected, media.statistics()) == (0, {})
    assert media.camera.status == "idle"


async def test_failed_camera_reports_why_and_video_resumes_with_it(camera, media, connected):
    page = await connected("p1")
    await until(lambda: len(page.pictures) > 5)
    camera.fail("the camera is unplugged")
    await until(lambda: media.camera.status == "failed")
    assert media.camera.reason == "the camera is unplugged"
    await asyncio.sleep(1.0)  # so that this is the longest gap between two pictures
    assert media.connected == 1, "the viewer was disconnected"
    camera.recover()
    await more(page)
    first = max(
        range(1, len(page.pictures)), key=lambda n: step(page.pictures[n - 1], page.pictures[n])
    )
    assert page.pictures[first][1], "a fresh encoder begins with a key frame"
    assert media.camera.status == "live"
    assert not page.exchange.byes("p1")


async def test_silent_camera_is_restarted(camera, media, connected):
    page = await connected("p1")
    await until(lambda: len(page.pictures) > 5)
    camera.fall_silent()
    await until(lambda: media.camera.status == "failed")
    assert "sent no data" in media.camera.reason
    camera.recover()
    await more(page)
    assert camera.starts >= 2


async def test_media_clock_is_right_after_an_outage_of_the_camera(camera, connected):
    page = await connected("p1", decode=True)
    await until(lambda: len(page.images) > 5)
    camera.fail("away")
    await until(lambda: not camera.running)
    camera.recover()
    held = len(page.images)
    await until(lambda: camera.running and len(page.images) > min(held, 15) + 3)
    await until(lambda: read_code(page.images[-1]) is not None and page.clocks())
    clock, newest = page.clocks()[-1], page.pictures[-1][0]
    assert 0 <= time.time() - capture_stamp(clock, newest) < 1.0


async def test_snapshot_starts_the_camera_and_stops_it_again(camera, media):
    frame = await asyncio.to_thread(media.snapshot)
    assert frame.image.shape == (480, 640, 3)
    assert time.time() - frame.stamp < 1.0
    await until(lambda: not camera.running, what="a stopped camera")


async def test_failed_camera_gives_no_snapshot(camera, media):
    camera.fail("unplugged")
    assert await asyncio.to_thread(media.snapshot) is None


async def test_frames_have_the_role_of_the_lease(media, exchange, connected):
    media.lease_changed("p1")
    driver = await connected("p1", "driver")
    observer = await connected("p2", "observer")
    driver.channel.send(encode_frame("command/point", PointCommand(peer="p1", stamp=1.0)))
    await until(lambda: exchange.heard)
    observer.channel.send(encode_frame("command/point", PointCommand(peer="p2", stamp=1.0)))
    await until(lambda: len(exchange.heard) == 2)
    assert [(peer, role, frame.peer) for peer, role, frame in exchange.heard] == [
        ("p1", "driver", "p1"),
        ("p2", "observer", "p2"),
    ]


async def test_driver_who_loses_the_lease_is_observer_at_once_and_then_disconnected(
    media, exchange, connected, monkeypatch
):
    monkeypatch.setattr("robots.agent.media.peers.registry.STAYS_AFTER_DRIVING", 1.0)
    media.lease_changed("p1")
    page = await connected("p1", "driver")
    page.channel.send("one")
    await until(lambda: len(exchange.heard) == 1)
    media.lease_changed("p2")
    page.channel.send("two")
    await until(lambda: len(exchange.heard) == 2)
    assert [role for _, role, _ in exchange.heard] == ["driver", "observer"]
    await until(lambda: exchange.byes("p1") == ["lease_changed"] and media.connected == 0)
    await more(await connected("p1", "observer"))


@pytest.mark.nightly
async def test_observer_is_disconnected_when_the_server_stops_vouching(
    media, exchange, new_page, monkeypatch
):
    """The connection would otherwise outlive the page's socket, over which the server ends it."""
    page, screen, forgotten = new_page("p1"), new_page("s1"), new_page("p2")
    await page.connect("observer")
    await screen.connect("screen")
    await forgotten.connect("observer")
    while not exchange.byes("p2"):
        for peer in ("p1", "s1"):
            media.signal(peer, Stay())
        await asyncio.sleep(0.2)
        monkeypatch.setattr("robots.agent.media.peers.registry.STAYS_UNVOUCHED", 5.0)
    assert exchange.byes("p2") == ["not_vouched"]
    assert (exchange.byes("p1"), exchange.byes("s1"), media.connected) == ([], [], 1)


async def test_oversized_and_excess_frames_are_dropped_and_counted(media, exchange, connected):
    page = await connected("p1")
    page.channel.send(" " * (MAX_BYTES + 1))
    sent = 0

    def fills_the_gate():
        """Send more when all frames have arrived: a busy computer takes seconds for a few hundred,
        in which the gate admits more of them.
        """
        nonlocal sent
        dropped = media.statistics()["p1"]
        if len(exchange.heard) + dropped["too_fast"] >= sent:
            for _ in range(150):
                page.channel.send(b"x")
            sent += 150
        return dropped["too_fast"] > 100 and dropped["oversized"]

    await until(fills_the_gate, what="a full gate")
    page.channel.send(encode_frame("command/action", Stop(action_id="s1", stamp=1.0)))
    await until(lambda: isinstance(exchange.heard[-1][2], Stop), what="the stop")
    assert len(exchange.heard) <= sent + 1 - 100


@pytest.mark.nightly
async def test_flooding_page_is_disconnected_and_may_return_after_a_pause(
    media, exchange, connected
):
    for refusals in (300, 0):  # on two connections: a new one does not reset the limits
        page = await connected("p1")
        for _ in range(450):
            page.channel.send(encode_frame("command/action", Stop(action_id="s1", stamp=1.0)))
        await until(
            lambda least=refusals: not least or media.statistics()["p1"]["too_fast"] > least,
            what="its frames",
        )
    await until(lambda: exchange.byes("p1") == ["flooded"] and media.connected == 0, what="the end")

    def refused():
        media.signal("p1", SdpOffer(sdp="v=0", role="observer"))
        return exchange.byes("p1")[-1] == "flooded"

    refused()
    await until(lambda: exchange.byes("p1") == ["flooded", "flooded"], what="the refusal")
    await until(lambda: not refused(), 2 * FLOOD_PAUSE, what="an offer that is looked at")
    await connected("p1")


async def test_telemetry_reaches_every_page(media, connected):
    first, second = await connected("p1"), await connected("p2")
    update = words.pose(stamp=5.0)
    media.telemetry("pose", update)
    await until(lambda: ("pose", update) in first.messages and ("pose", update) in second.messages)


async def test_heartbeat_sends_each_page_only_its_own_echo(media, connected):
    pages = [await connected("p1"), await connected("p2")]
    echoes = tuple(Echo(peer=name, n=1, stamp=1.0, received=1.5) for name in ("p1", "p2", "p3"))
    media.telemetry("heartbeat", Heartbeat(n=3, stamp=2.0, echoes=echoes))
    for page in pages:
        own = tuple(echo for echo in echoes if echo.peer == page.peer)
        await until(
            lambda page=page, own=own: (
                ("heartbeat", Heartbeat(n=3, stamp=2.0, echoes=own)) in page.messages
            )
        )


async def test_pointer_reaches_only_the_other_side(media, connected):
    media.lease_changed("p1")
    pages = [
        await connected(peer, role)
        for peer, role in (("p1", "driver"), ("p2", "observer"), ("screen", "screen"))
    ]
    from_driver, from_screen = (
        Pointer(stamp=5.0, by="driver", at=(0.25, 0.75)),
        Pointer(stamp=6.0, by="screen"),
    )
    media.point(from_driver)
    media.point(from_screen)
    media.telemetry("heartbeat", Heartbeat(n=9, stamp=7.0))
    for page in pages:
        await until(lambda page=page: any(suffix == "heartbeat" for suffix, _ in page.messages))
    pointers = [
        [message for suffix, message in page.messages if suffix == "pointer"] for page in pages
    ]
    assert pointers == [[from_screen], [], [from_driver]]


async def test_telemetry_for_a_slow_page_is_dropped(media, connected):
    page = await connected("p1")
    viewer = media._pages._viewers["p1"]
    channel = viewer.page.channels[0]
    channel._addBufferedAmount(10_000_000)
    for n in range(5):
        media.telemetry("heartbeat", Heartbeat(n=n, stamp=1.0))
    await until(lambda: viewer.page.dropped_telemetry >= 5)
    assert all(suffix == "media" for suffix, _ in page.messages)


async def test_full_robot_refuses_observers_and_makes_room_for_the_driver(
    media, exchange, new_page, connected
):
    for number in range(3):
        await connected(f"p{number}")
    late = new_page("late")
    media.signal("late", SdpOffer(sdp=await late.offer_sdp()))
    await until(lambda: exchange.byes("late") == ["full"])
    await connected("driver", "driver")
    assert exchange.byes("p2") == ["full"], "the newest observer must leave"
    assert media.connected == 3


async def test_repeated_offer_replaces_the_connection(media, exchange, connected):
    await connected("p1")
    again = await connected("p1")
    await until(lambda: len(again.pictures) > 3)
    assert media.connected == 1
    assert exchange.byes("p1") == []


async def test_page_that_closes_its_connection_is_removed(media, exchange, connected):
    page = await connected("p1")
    await page.connection.close()
    await until(lambda: exchange.byes("p1") == ["failed"], what="the end")
    assert media.statistics() == {}


async def test_page_that_never_connects_frees_its_place(media, exchange, new_page, monkeypatch):
    monkeypatch.setattr(signalling, "CONNECT_TIMEOUT", 0.5)
    page = new_page("p1")
    media.signal("p1", SdpOffer(sdp=await page.offer_sdp()))
    await until(lambda: exchange.byes("p1") == ["failed"], what="the end")
    assert media.statistics() == {}


async def test_only_a_silent_page_is_removed(media, exchange, connected, monkeypatch):
    quiet = await connected("quiet")
    speaking = await connected("speaking")
    for page in (quiet, speaking):
        page.fall_silent()
        media._pages._viewers[page.peer]._pictures.on_report()
    monkeypatch.setattr(signalling, "SILENCE", 1.5)
    await until(
        lambda: speaking.channel.send("command/heartbeat\n{}") or exchange.byes("quiet"),
        what="the end of the quiet one",
    )
    assert exchange.byes("quiet") == ["failed"]
    assert exchange.byes("speaking") == []


async def test_page_gets_a_bye_when_its_video_fails_and_may_reconnect(
    media, exchange, connected, monkeypatch, caplog
):
    page = await connected("p1")
    await until(lambda: len(page.pictures) > 5)
    with monkeypatch.context() as broken:
        broken.setattr(RtpStream, "packets", lambda *_, **__: 1 / 0)
        await until(lambda: exchange.byes("p1") == ["failed"], what="a goodbye")
    assert "sender_failed" in caplog.text
    assert "ZeroDivisionError" in caplog.text
    await more(await connected("p1"))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
async def test_camera_is_restarted_after_an_unexpected_error(camera, media, connected, monkeypatch):
    page = await connected("p1")
    await until(lambda: len(page.pictures) > 5)
    monkeypatch.setattr(camera, "read", lambda timeout: {}["unforeseen"])
    await until(lambda: not media._camera._thread.is_alive(), what="a dead thread")
    monkeypatch.undo()
    await more(page)


async def test_candidates_that_arrive_before_their_offer_are_used(media, exchange, new_page):
    page = new_page("p1")
    sdp = await page.offer_sdp()
    candidates = [line[2:] for line in sdp.splitlines() if line.startswith("a=candidate:")]
    plain = "".join(line + "\r\n" for line in sdp.splitlines() if "candidate" not in line)
    for candidate in candidates:
        media.signal("p1", Candidate(candidate=candidate, sdp_m_line_index=0))
    media.signal("p1", Candidate())
    media.signal("p1", SdpOffer(sdp=plain))
    await until(lambda: exchange.answers("p1"))
    await page.take_answer()
    await until(lambda: len(page.pictures) > 3, what="pictures")


async def test_unresolvable_candidate_name_delays_nothing(media, exchange, new_page):
    page = new_page("p1")
    sdp = await page.offer_sdp()
    sdp = sdp.replace("a=candidate", f"a={UNKNOWN}\r\na=candidate", 1)
    media.signal("p1", SdpOffer(sdp=sdp))
    began = time.monotonic()
    await until(lambda: exchange.answers("p1"))
    assert time.monotonic() - began < 0.8, "aioice waits 1 s for such a name"
    await page.take_answer()
    await until(lambda: len(page.pictures) > 3, what="pictures")


async def test_unusable_offer_is_refused_without_affecting_others(
    media, exchange, new_page, connected
):
    watcher = await connected("p0")
    good = await new_page("x").offer_sdp()
    rubbish = [
        "",
        "rubbish",
        "v=0\r\n",
        good.replace("VP8", "XX9"),
        good.replace("a=fingerprint", "a=fingerless"),
        good.replace("m=video", "m=smell"),
    ]
    for number, sdp in enumerate(rubbish):
        media.signal(f"bad{number}", SdpOffer(sdp=sdp))
        await until(
            lambda number=number: exchange.byes(f"bad{number}") == ["failed"],
            what=f"refusal {number}",
        )
    await more(watcher, 10)


def open_sockets():
    """Return the number of sockets of this process."""
    found = 0
    for link in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            found += str(link.readlink()).startswith("socket:")
    return found


@pytest.mark.parametrize("relay", ["none", "silent"])
@pytest.mark.parametrize("then", ["stays", "leaves"])
async def test_replaced_offers_leave_no_socket(media, exchange, new_page, relay, then):
    sdp = await new_page("x").offer_sdp()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        url = f"stun:127.0.0.1:{silent.getsockname()[1]}"
        servers = () if relay == "none" else (IceServer(urls=(url,)),)
        before = open_sockets()
        peers = [f"p{number}" for number in range(12)]
        for number, peer in enumerate(peers):
            for _ in range(3):
                media.lease_changed(peer)
                media.signal(peer, SdpOffer(sdp=sdp, role="driver", ice_servers=servers))
                await asyncio.sleep(number * 0.001)
            if then == "stays":
                await until(lambda peer=peer: exchange.answers(peer), what="an answer")
            media.signal(peer, Bye())
        await until(lambda: media.statistics() == {})
        await until(lambda: not media._pages._tasks, what="the end of all tasks")
        await until(lambda: open_sockets() <= before, 3.0, "as many sockets as before")


async def test_page_that_offers_too_often_is_refused_without_affecting_others(
    media, exchange, new_page, connected
):
    watcher = await connected("p1")
    for number in range(40):
        media.signal("p2", SdpOffer(sdp="rubbish"))
        media.signal(f"other{number}", SdpOffer(sdp="rubbish"))
    await until(lambda: exchange.byes("p2").count("flooded") >= 35, what="refusals")
    await until(lambda: exchange.byes("other39") == ["flooded"], what="a limit of all together")
    driver = new_page("p3")
    media.lease_changed("p3")
    await driver.connect("driver")
    await more(watcher, 10)
    assert len(driver.pictures) > 0


@pytest.mark.nightly
async def test_every_mangled_offer_is_answered_or_refused(
    media, exchange, new_page, connected, caplog
):
    good = (await new_page("x").offer_sdp()).splitlines()
    generator, before = random.Random(5), open_sockets()
    for number in range(120):
        lines = list(good)
        for _ in range(generator.randrange(1, 4)):
            index = generator.randrange(len(lines))
            line = lines[index]
            cut = generator.randrange(len(line) + 1)
            lines[index : index + 1] = generator.choice(
                [
                    [],
                    [line, line],
                    [line[:cut]],
                    [line[:cut] + "\u00e9-1" + line[cut:]],
                    [line.replace("1", "99999999999")],
                ]
            )
        peer = f"m{number}"
        media.lease_changed(peer)  # the driver's offers are not limited
        media.signal(peer, SdpOffer(sdp="\r\n".join(lines) + "\r\n"))
        await until(
            lambda peer=peer: exchange.answers(peer) or exchange.byes(peer),
            what=f"a reply to {lines}",
        )
        media.signal(peer, Bye())
    await until(lambda: media.statistics() == {})
    await until(lambda: open_sockets() <= before, 3.0, "as many sockets as before")
    assert "media_task_failed" not in caplog.text
    media.lease_changed("p1")
    await connected("p1", decode=True)


async def test_robot_without_camera_has_a_data_channel():
    async with MediaRig() as rig:
        page = rig.page("p1")
        await page.connect()
        page.channel.send("hello")
        await until(lambda: rig.exchange.heard)
        assert rig.media.snapshot() is None
        assert rig.media.camera is None


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
async def test_failed_media_loop_has_ended(media, monkeypatch):
    assert not media.ended
    monkeypatch.setattr(media._pages, "end_lost", lambda now: 1 / 0)
    await until(lambda: media.ended, what="its end")
    media.signal("p2", Bye())


async def test_closing_sends_byes_and_stops_camera_microphone_and_thread(
    camera, microphone, media, exchange, connected
):
    await connected("p1")
    await asyncio.to_thread(media.close)
    await until(lambda: exchange.byes("p1") == ["left"])
    assert not camera.running
    assert not microphone.running
    assert not media._thread.is_alive()
    media.close()
    media.signal("p2", Bye())
    media.telemetry("heartbeat", Heartbeat(n=1, stamp=1.0))


async def test_offer_after_the_bye_gets_another_bye_and_leaves_no_tasks(camera):
    unknown = Candidate(candidate=UNKNOWN, sdp_m_line_index=0)

    def reply(peer, message):
        rig.exchange.reply(peer, message)
        if isinstance(message, Bye) and len(asked) < 50:
            asked.append(message)
            rig.media.signal(peer, SdpOffer(sdp=sdp))
            rig.media.signal(peer, unknown)

    asked: list[Bye] = []
    async with MediaRig(video=camera, reply=reply) as rig:
        page = rig.page("p1", decode=False)
        await page.connect()
        sdp = await page.offer_sdp()
        answers = len(rig.exchange.answers("p1"))
        await asyncio.to_thread(rig.media.close)
        await asyncio.sleep(0)  # replies pass through the loop
        assert len(rig.exchange.answers("p1")) == answers
        assert set(rig.exchange.byes("p1")) == {"left"}
        assert len(asked) > 1
    gc.collect()  # reports unfinished tasks
