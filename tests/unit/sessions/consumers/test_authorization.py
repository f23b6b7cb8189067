"""The rules of a page's connection, without a connection."""

import math

import msgspec
import pytest
from hypothesis import given, strategies as st

from robots.api import codec, messages as m
from sessions import protocol
from sessions.consumers.authorization import (
    Authorization,
    Close,
    DenyFrame,
    Halt,
    Publish,
    PublishAsOperator,
    ReportFrame,
    ToSfu,
    Verb,
    Write,
)
from tests.support import words
from tests.support.examples import examples

PEER, SESSION = "peer-1", "session-1"
ICE = (m.IceServer(urls=("stun:stun.example.org",)),)
LEASE = m.Lease(session=SESSION, epoch=7, peer=PEER, who="Ada", renewal=1, stamp=1.0)
FORGED = {"session": "other", "epoch": 999}


def driver(**options):
    authorization = Authorization(PEER, "Ada", ice_servers=lambda: ICE, **options)
    authorization.drive(SESSION, 7, PEER)
    return authorization


def observer(**options):
    authorization = Authorization("peer-2", "Bob", ice_servers=lambda: ICE, **options)
    authorization.observe()
    return authorization


SUFFIXES_OF_KINDS = {
    m.VelocityCommand: "command/velocity",
    m.CommandHeartbeat: "command/heartbeat",
    m.PictureRequest: "command/picture",
    m.PointCommand: "command/point",
    m.RouteRequest: "command/route",
    protocol.PageEvent: "page/event",
    protocol.PageNetwork: "page/network",
    protocol.Take: "session/take",
}


def suffix_of(message):
    other = "command/action" if isinstance(message, m.Action) else "signal"
    return SUFFIXES_OF_KINDS.get(type(message), other)


def say(authorization, message, lease=LEASE, now=0.0):
    return authorization.receive(codec.encode_frame(suffix_of(message), message), lease, now)


def denied(authorization, message, lease=LEASE, now=0.0):
    """Return the reason for which a message is refused."""
    (effect,) = say(authorization, message, lease, now)
    assert effect == DenyFrame(suffix_of(message), effect.reason)
    return effect.reason


def action(kind, **fields):
    return kind(**{"action_id": "a1", "stamp": 1.0, **fields})


def guest(**options):
    return Authorization("peer-4", "Eve", ice_servers=lambda: ICE, **options)


def waiting():
    authorization = Authorization("peer-3", "Cem", ice_servers=lambda: ICE)
    authorization.wait("session-3")
    return authorization


DRIVERS_ACTIONS = [
    action(m.Goto, x=1.0, y=2.0),
    action(m.Follow, points=((0.0, 0.0),)),
    action(m.Dock),
    action(m.Undock),
    action(m.Cancel),
    action(m.Tilt, angle=0.1),
    action(m.Photo),
    action(m.Relocalize),
    action(m.Say, text="hello"),
    action(m.Call),
]


each_action = pytest.mark.parametrize("asked", DRIVERS_ACTIONS, ids=lambda one: type(one).__name__)


@each_action
def test_a_drivers_action_is_stamped_with_role_session_epoch_and_user(asked):
    forged = msgspec.structs.replace(asked, role="owner", user="Mallory", **FORGED)
    stamped = msgspec.structs.replace(asked, role="driver", user="Ada", session=SESSION, epoch=7)
    assert say(driver(), forged) == (Publish("command/action", stamped),)


@each_action
def test_an_observers_action_is_refused(asked):
    assert denied(observer(), asked) == "observer"
    assert denied(observer(operator="owner"), action(m.Goto, x=0.0, y=0.0)) == "observer"


def test_an_observers_velocity_heartbeat_and_report_are_refused():
    assert denied(observer(), words.velocity(session=SESSION, epoch=7)) == "observer"
    assert denied(observer(), m.CommandHeartbeat(n=1, stamp=1.0, peer=PEER)) == "observer"
    assert denied(observer(), protocol.PageEvent(stamp=1.0, type="x")) == "no_session"


@pytest.mark.parametrize(
    "lease",
    [
        None,
        msgspec.structs.replace(LEASE, epoch=8),
        msgspec.structs.replace(LEASE, session="other"),
        msgspec.structs.replace(LEASE, peer="peer-9"),
    ],
    ids=["none", "a later epoch", "another session", "another page"],
)
def test_a_driver_without_the_lease_in_force_may_stop_and_nothing_else(lease):
    authorization = driver()
    assert denied(authorization, words.velocity(), lease) == "not_driver"
    assert denied(authorization, action(m.Goto, x=0.0, y=0.0), lease) == "not_driver"
    assert denied(authorization, m.SdpOffer(sdp="v=0"), lease) == "not_driver"
    assert isinstance(say(authorization, action(m.Stop), lease)[0], Halt)


@pytest.mark.parametrize("kind", [m.Stop, m.EStop])
@pytest.mark.parametrize("make", [driver, observer, guest])
def test_stop_and_estop_pass_from_every_page_under_its_own_name(make, kind):
    (effect,) = say(make(), action(kind, role="owner", user="Mallory", **FORGED))
    sent = effect.message
    if make is driver:
        assert (sent.role, sent.user, sent.session, sent.epoch) == ("driver", "Ada", SESSION, 7)
    else:
        assert (sent.role, sent.user, sent.session, sent.epoch) == ("observer", make().who, None, 0)


def test_the_number_of_a_stop_counts_only_from_the_driver():
    assert say(driver(), action(m.Stop, seq=40))[0].message.seq == 40
    assert say(observer(), action(m.Stop, seq=40))[0].message.seq == 0


def test_operators_clear_an_emergency_stop_under_their_own_role_and_resend_no_states():
    assert denied(driver(), action(m.ClearEStop, role="owner", user="Ada")) == "not_allowed"
    assert denied(observer(), action(m.ClearEStop, role="staff", user="Ada")) == "not_allowed"
    for page in (driver(operator="staff"), observer(operator="owner")):
        (effect,) = say(page, action(m.ClearEStop, role="server", user="Mallory"))
        assert isinstance(effect, PublishAsOperator)  # once the database confirms the rights
        assert (effect.message.role, effect.message.user) == (page.operator, page.who)
    resend = action(m.ResendStates, boot="b", first=1, last=2, role="server")
    assert denied(driver(operator="owner"), resend) == "not_allowed"


@pytest.mark.parametrize("kind", [m.Photo, m.Relocalize, m.Cancel])
def test_an_operator_needs_no_lease_for_actions_of_its_role(kind):
    (effect,) = say(observer(operator="staff"), action(kind, role="driver"))
    assert (effect.message.role, effect.message.session, effect.message.epoch) == ("staff", None, 0)


def through_sfu():
    authorization = observer()
    authorization.observe(by_sfu=True)
    return authorization


SFU_SIGNALS = [
    protocol.WantOffer(),
    m.SdpAnswer(sdp="v=0"),
    m.Candidate(candidate="candidate:1"),
    m.Bye(reason="left"),
]


@pytest.mark.parametrize("signal", SFU_SIGNALS)
def test_signals_of_a_page_that_watches_through_the_sfu_go_to_the_sfu(signal):
    assert say(through_sfu(), signal) == (ToSfu(signal),)


def test_a_page_that_watches_through_the_sfu_sends_the_robot_no_offer_or_request():
    page = through_sfu()
    assert denied(page, m.SdpOffer(sdp="v=0")) == "no_role"
    assert denied(page, m.PictureRequest(stamp=1.0), now=2.0) == "sfu"


@pytest.mark.parametrize("signal", SFU_SIGNALS[:2])
@pytest.mark.parametrize("page", [driver, observer])
def test_other_pages_send_nothing_to_the_sfu(page, signal):
    assert denied(page(), signal) == "no_role"


def test_driver_no_longer_watches_through_the_sfu():
    page = through_sfu()
    page.drive(SESSION, 7, PEER)
    assert not page.by_sfu


@pytest.mark.parametrize("signal", [m.Candidate(candidate="c", sdp_mid="0"), m.Bye(reason="left")])
@pytest.mark.parametrize("page", [driver, observer])
def test_candidates_and_the_end_of_a_connection_go_to_the_pages_own(page, signal):
    authorization = page()
    own = f"signal/{authorization.peer}"
    assert say(authorization, signal) == (Publish(own, signal),)


def test_waiting_page_may_watch_but_not_drive():
    page = waiting()
    page.observe()
    (effect,) = say(page, m.SdpOffer(sdp="v=0", role="driver"))
    assert effect.message.role == "observer"
    assert denied(page, words.velocity()) == "observer"
    assert denied(guest(), m.SdpOffer(sdp="v=0")) == "no_role"


def test_a_granted_page_no_longer_watches():
    authorization = observer()
    authorization.drive(SESSION, 7, PEER)
    assert not authorization.watches
    assert authorization.holds(LEASE)


@pytest.mark.parametrize(
    "suffix",
    ["", "lease", "config", "floorplan", "state", "hello", "command/velocity/x", "signal/peer-9"],
)
def test_a_page_uses_no_suffix_but_its_own(suffix):
    (effect,) = driver().receive(f"{suffix}\n{{}}", LEASE, 0.0)
    assert effect == DenyFrame(suffix, "unknown_topic")


def velocity_frame(linear, seq=1):
    return (
        f'command/velocity\n{{"session":"s","epoch":0,"seq":{seq},"stamp":1,'
        f'"linear":{linear},"angular":0,"method":"keyboard"}}'
    )


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        ("", "malformed"),
        ("no newline", "malformed"),
        ("command/velocity\n", "malformed"),
        ("command/velocity\n[]", "malformed"),
        (velocity_frame("NaN"), "malformed"),
        (velocity_frame("1e9"), "malformed"),
        (velocity_frame("0", seq=-1), "malformed"),
        ('command/action\n{"type":"fly","actionId":"a","stamp":1}', "malformed"),
        ("session/take\n" + "[" * 40_000, "malformed"),
        ("command/velocity\n" + " " * 2000, "oversized"),
        ("signal\n" + " " * protocol.MAX_FRAME, "oversized"),
        (b"\xff\xfe\n{}", "unknown_topic"),
        (b"\xff\xfe", "malformed"),
    ],
)
def test_malformed_frame_is_refused_with_its_reason(frame, reason):
    authorization = driver()
    (effect,) = authorization.receive(frame, LEASE, 0.0)
    assert effect.reason == reason
    assert authorization.refused == {reason: 1}


def test_verbs_go_to_the_database_and_reports_to_the_record():
    authorization = driver()
    assert say(authorization, protocol.Take(takeover=True)) == (
        Verb("session/take", protocol.Take(takeover=True)),
    )
    event = protocol.PageEvent(stamp=1.0, type="tab_hidden", data={"seconds": 2.0})
    raw = msgspec.Raw(codec.encode(event))
    report = protocol.PageReport(suffix="page/event", session=SESSION, message=raw)
    assert say(authorization, event) == (ReportFrame(report),)


def test_the_same_refusal_is_sent_once_a_second_and_counted_every_time():
    authorization = observer()
    sent = [say(authorization, words.velocity(), now=tick / 20) for tick in range(41)]
    assert sum(map(len, sent)) == 3
    assert authorization.refused == {"observer": 41}


@pytest.mark.parametrize(
    "data",
    [
        {"word": "x" * 201},
        {f"word-{n}": "x" * 100 for n in range(16)},
        {f"word-{n}": None for n in range(17)},
        {"x" * 121: 1.0},
    ],
)
def test_oversized_page_event_is_refused(data):
    (effect,) = say(driver(), protocol.PageEvent(stamp=1.0, type="cue_shown", data=data))
    assert isinstance(effect, DenyFrame)


def test_the_longest_reports_of_our_page_pass():
    layout = {"interface": "technical", "layout": "upright", "touch": False, "bot": True}
    numbers = ["width", "height", "screen_width", "screen_height", "density"]
    layout |= dict.fromkeys(numbers, 719.3333129882812)
    parts = ["server", "browser", "picture", "way", "detour", "microphone", "camera", "gamepad"]
    check = dict.fromkeys([*parts, "overall", "app"], "unsupported")
    answer = {"id": "answer-" + "0" * 24, "choice": "again", "photo": "p" * 64}
    figures = ["round_trip", "loss", "jitter", "fps", "freezes", "bitrate", "frame_age"]
    network = protocol.PageNetwork(
        stamp=1.7e9 + 1 / 3,
        way="datachannel",
        path="host/udp",
        **dict.fromkeys(figures, 1 / 3),
    )
    events = [
        protocol.PageEvent(stamp=1.7e9 + 1 / 3, type="layout", data=data)
        for data in (layout, check | {"roundTrip": 1 / 3}, answer)
    ]
    for message in (network, *events):
        (effect,) = say(driver(), message)
        assert isinstance(effect, ReportFrame)
        assert len(effect.message.message) < protocol.MAX_REPORT / 2


@pytest.mark.parametrize(
    ("message", "rate", "burst"),
    [
        (words.velocity(), 60, 60),
        (m.CommandHeartbeat(n=1, stamp=1.0), 30, 60),
        (action(m.Stop), 60, 60),
        (protocol.PageEvent(stamp=1.0, type="x"), 3, 60),
    ],
)
def test_more_than_a_page_needs_is_refused(message, rate, burst):
    authorization = driver()
    passed = sum(
        isinstance(effect, Publish | Halt | ReportFrame)
        for tick in range(2000)
        for effect in say(authorization, message, now=tick / 200)
    )
    assert burst + 10 * rate - 1 <= passed <= burst + 10 * rate + 1


def test_a_stop_passes_when_everything_else_has_been_used_up():
    authorization = driver()
    for _ in range(200):
        say(authorization, words.velocity())
        say(authorization, action(m.Photo))
    assert isinstance(say(authorization, action(m.Stop))[0], Halt)


def test_only_a_page_that_drove_over_its_socket_sends_a_stop_when_it_leaves():
    authorization = driver()
    assert authorization.parting_stop("a", 5.0, LEASE, 0.0) is None
    say(authorization, words.velocity(seq=17), now=10.0)
    stop = authorization.parting_stop("a", 5.0, LEASE, 10.5)
    assert stop == m.Stop(
        action_id="a", stamp=5.0, session=SESSION, epoch=7, role="driver", user="Ada", seq=17
    )
    assert authorization.parting_stop("a", 5.0, LEASE, 12.0) is None
    assert authorization.parting_stop("a", 5.0, None, 10.5) is None
    assert observer().parting_stop("a", 5.0, LEASE, 0.0) is None


@pytest.mark.parametrize("kind", [m.Stop, m.EStop])
@pytest.mark.parametrize(
    ("make", "then"),
    [
        (driver, Authorization.leave),
        (observer, lambda _: None),
        (driver, lambda page: page.wait("s2")),
    ],
    ids=["left", "reconnected", "waits again"],
)
def test_a_late_copy_of_a_drivers_stop_names_the_drive_that_has_ended(kind, make, then):
    authorization = make()
    then(authorization)
    for claimed in (SESSION, None):
        (halt,) = say(authorization, action(kind, session=claimed, epoch=7), lease=None)
        assert (halt.message.session, halt.message.epoch) == (claimed, 0)
        assert halt.message.role == "observer"


# --- arbitrary frames -----------------------------------------------------------------------------

SUFFIXES = st.sampled_from(["signal", "lease", ""]) | st.text(max_size=20)
SUFFIXES |= st.sampled_from(["command/velocity", "command/heartbeat", "command/action"])
SUFFIXES |= st.sampled_from(["command/point", "command/route", "session/take", "page/event"])
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(["type", "session", "epoch", "seq", "role", "sdp", "x", "at", "stamp"]),
            inner,
            max_size=6,
        )
    ),
    max_leaves=12,
)
FRAMES = (
    st.text(max_size=200)
    | st.binary(max_size=200)
    | st.builds(
        lambda suffix, value: f"{suffix}\n{msgspec.json.encode(value).decode()}", SUFFIXES, JSON
    )
)
MESSAGES = st.one_of(
    st.builds(
        words.velocity,
        seq=st.integers(0, 2**40),
        linear=st.floats(-10, 10),
        session=st.sampled_from([SESSION, "x"]),
        epoch=st.integers(0, 20),
    ),
    st.builds(
        msgspec.structs.replace,
        st.sampled_from([*DRIVERS_ACTIONS, action(m.Stop), action(m.EStop), action(m.ClearEStop)]),
        role=st.sampled_from(["driver", "observer", "screen", "staff", "owner", "server"]),
        user=st.sampled_from(["", "Mallory"]),
    ),
    st.builds(
        m.PointCommand,
        stamp=st.just(1.0),
        role=st.sampled_from(["driver", "screen"]),
        session=st.sampled_from([None, SESSION]),
        peer=st.sampled_from([PEER, "x"]),
    ),
    st.builds(
        m.RouteRequest,
        request_id=st.just("r1"),
        stamp=st.just(1.0),
        x=st.floats(-5, 5),
        y=st.just(0.0),
        session=st.sampled_from([None, "x"]),
        epoch=st.integers(0, 20),
    ),
    st.builds(
        m.SdpOffer,
        sdp=st.just("v=0"),
        role=st.sampled_from(["driver", "observer", "screen"]),
        session=st.sampled_from([None, SESSION]),
    ),
)


@examples(400, thorough=15_000)
@given(frame=FRAMES, drives=st.booleans())
def test_no_frame_raises_and_only_complete_messages_have_an_effect(frame, drives):
    authorization = driver() if drives else observer()
    for effect in authorization.receive(frame, LEASE, 0.0):
        assert isinstance(effect, DenyFrame | Publish | Halt | Verb | ReportFrame)
        if isinstance(effect, Publish | Halt):
            suffix = "command/action" if isinstance(effect, Halt) else effect.suffix
            codec.decode(suffix, codec.encode(effect.message), "to_robot")


@examples(400, thorough=15_000)
@given(
    message=MESSAGES,
    place=st.sampled_from(["driver", "observer", "guest", "late"]),
    operator=st.sampled_from([None, "staff", "owner"]),
)
def test_claims_of_a_page_about_itself_do_not_reach_the_robot(message, place, operator):
    make = {"driver": driver, "late": driver, "observer": observer, "guest": guest}[place]
    authorization = make(operator=operator)
    lease = msgspec.structs.replace(LEASE, epoch=8) if place == "late" else LEASE
    for effect in say(authorization, message, lease):
        if not isinstance(effect, Publish | Halt):
            continue
        sent = effect.message
        if isinstance(sent, m.VelocityCommand):
            assert place == "driver"
            assert (sent.session, sent.epoch) == (SESSION, 7)
            assert math.isfinite(sent.linear)
        elif isinstance(sent, m.RouteRequest):
            assert place == "driver"
            assert (sent.session, sent.epoch) == (SESSION, 7)
        elif isinstance(sent, m.PointCommand):
            assert (place, sent.role, sent.peer) == ("driver", "driver", PEER)
            assert (sent.session, sent.epoch) == (SESSION, 7)
        else:
            own = (SESSION, 7) if sent.role == "driver" else (None, 0)
            assert (sent.session, sent.epoch) == own
            role = "driver" if place == "driver" else "observer"
            assert sent.role in {role, operator or "observer"}
        if isinstance(sent, m.Action):
            assert sent.user == authorization.who


# --- pictures through the server ------------------------------------------------------------------

WANTED = m.PictureRequest(stamp=1.0, peer="somebody-else", seen=0.5, round_trip=0.02)


def test_one_request_is_answered_with_one_picture():
    authorization = observer()
    assert not authorization.may_see_picture(LEASE)
    say(authorization, WANTED)
    say(authorization, WANTED)
    assert authorization.may_see_picture(LEASE)
    assert not authorization.may_see_picture(LEASE)


def test_a_driver_who_has_lost_the_lease_gets_no_picture():
    authorization = driver()
    say(authorization, WANTED)
    assert not authorization.may_see_picture(msgspec.structs.replace(LEASE, epoch=8, peer="peer-9"))
    assert denied(authorization, WANTED, lease=None) == "not_driver"


def test_a_requested_picture_is_not_sent_to_a_page_that_has_left():
    authorization = observer()
    say(authorization, WANTED)
    authorization.leave()
    assert not authorization.may_see_picture(LEASE)


def test_a_flood_of_requests_is_cut():
    authorization = observer()
    effects = [effect for _ in range(1000) for effect in say(authorization, WANTED)]
    assert sum(isinstance(effect, Publish) for effect in effects) <= 60
    assert isinstance(effects[-1], Close)


def test_photos_are_rate_limited_and_a_stop_still_passes():
    authorization = driver()
    taken = [
        say(authorization, action(m.Photo, action_id=f"p{n}"), now=n * 0.1)[:1] for n in range(30)
    ]
    assert sum(isinstance(effects[0], Publish) for effects in taken if effects) == 11
    assert isinstance(say(authorization, action(m.Stop, seq=1), now=3.0)[0], Halt)
    later = action(m.Photo, action_id="later")
    assert isinstance(say(authorization, later, now=10.0)[0], Publish)


# --- dots on what the driver shares ---------------------------------------------------------------

DOT = m.PointCommand(stamp=5.0, at=(0.5, 0.25), role="screen", peer="somebody-else", **FORGED)


def test_only_the_driver_may_point():
    assert denied(observer(), DOT) == "observer"
    assert denied(guest(), DOT) == "not_driver"
    assert denied(driver(), DOT, msgspec.structs.replace(LEASE, epoch=8)) == "not_driver"


@pytest.mark.parametrize(
    "at", ["[1.5,0.5]", "[-0.1,0.5]", "[NaN,0.5]", "[0.5]", "0.5", '{"x":0.5,"y":0.5}']
)
def test_a_dot_outside_the_picture_is_refused(at):
    frame = f'command/point\n{{"stamp":5.0,"at":{at}}}'
    assert driver().receive(frame, LEASE, 0.0) == (DenyFrame("command/point", "malformed"),)


def test_twenty_dots_a_second_pass_and_leave_room_for_stops_and_chat():
    authorization = driver()
    dots = [msgspec.structs.replace(DOT, stamp=5.0 + n / 50) for n in range(500)]
    effects = [say(authorization, dot, now=n / 50) for n, dot in enumerate(dots)]
    passed = sum(isinstance(effect[0], Publish) for effect in effects if effect)
    assert passed == pytest.approx(210, abs=2)
    assert isinstance(say(authorization, action(m.Stop, seq=1), now=10.0)[0], Halt)
    for n in range(60):
        hello = action(m.Say, text="hello", action_id=f"s{n}")
        assert isinstance(say(authorization, hello, now=10.0)[0], Publish)
    steady = driver()
    assert all(isinstance(say(steady, DOT, now=n / 15)[0], Publish) for n in range(300))


def test_waiting_page_may_only_chat_while_there_is_no_driver():
    hello = action(m.Say, text="hello")
    assert say(waiting(), hello, lease=None) == (Write(hello),)
    assert denied(waiting(), hello, lease=LEASE) == "not_driver"
    for other in DRIVERS_ACTIONS:
        if not isinstance(other, m.Say):
            assert denied(waiting(), other, lease=None)
    assert denied(guest(), hello, lease=None) == "not_driver"
