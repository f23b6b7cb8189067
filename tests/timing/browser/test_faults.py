"""What fails, fails safe: page, tab, network, agent, servers. Every test measures what the base was
told and what it did.

Times are the robot's own, from the simulator's history and from the record; here all clocks are
one.
"""

import contextlib
import signal
import time
from itertools import pairwise

import pytest

from tests.support.agents.truth import Onlooker, Row
from tests.support.browsers.chromium import CHROMIUM
from tests.support.browsers.visitor import Visitor, chromium
from tests.support.host_jitter import watched
from tests.support.patience import patient
from tests.support.programs.namespace import HERE, namespace
from tests.support.sessions.site import wait_for

pytestmark = pytest.mark.browser
DEADLINE = 0.350  # s from the last accepted command to the first command that brakes
WATCHDOG = 0.300  # s, the simulated base's own
BRAKING = 0.8  # m/s², checked against the factsheet below
STEP = 0.02  # s: the simulator's step and the agent's tick are seen at this grain

MUFFLE = """
  const { WebSocket: Socket, RTCPeerConnection: Connection } = window;
  window.muffled = false;
  const muffle = (thing) => {
    const send = thing.send.bind(thing);
    thing.send = (data) => {
      if (!window.muffled || !String(data).startsWith('command/')) send(data);
    };
    return thing;
  };
  window.WebSocket = class extends Socket { constructor(...a) { super(...a); muffle(this); } };
  window.RTCPeerConnection = class extends Connection {
    createDataChannel(...a) { return muffle(super.createDataChannel(...a)); }
  };
"""
LEASE = 10.0  # s that a lease lives after its renewal


@pytest.fixture(scope="module")
def computer():
    with watched() as jitter:
        yield jitter


@pytest.fixture
def giraff(site, computer):
    """A robot in the corridor with more than six metres ahead of it, and nobody who drives it."""
    wait_for(
        lambda: all(state == "ended" for _, _, state, _ in site.sessions()),
        60,
        "the end of earlier visits",
    )
    with site.robot("giraff", "--start", "corridor-centre") as onlooker:
        onlooker.computer = computer
        yield onlooker


@pytest.fixture
def driver(visitor, giraff):
    """A visitor who is driving."""
    return under_way(visitor("anna").drive(), giraff)


def under_way(someone: Visitor, giraff: Onlooker, *, slowly: bool = False) -> Visitor:
    someone.wait_for("link", "live")
    if slowly:
        someone.page.locator("[data-action=speed-0]").click()
    someone.hold("ArrowUp", lambda: steady(giraff), 15, "a steady speed")
    return someone


def steady(giraff: Onlooker) -> bool:
    speeds = [row.commanded_linear for row in giraff.history(0.5)]
    return len(speeds) > 20 and min(speeds) > 0.1 and max(speeds) - min(speeds) < 0.001


def standstill(giraff: Onlooker) -> bool:
    return abs(giraff.truth().linear) < 1e-3


def brakes_at(history: list[Row]) -> Row:
    """Return the first row of the last braking: where the command falls below the steady speed and
    never comes back.
    """
    speed = max(row.commanded_linear for row in history)
    last = max(index for index, row in enumerate(history) if row.commanded_linear > 0.98 * speed)
    return history[last + 1]


def check_stop(site, giraff: Onlooker) -> float:
    """The base was told to stop in time after the last accepted command, and stood after its
    braking time. Return the former.
    """
    wait_for(lambda: standstill(giraff), 5, "a standing robot")
    session = site.sessions()[-1][0]
    history = giraff.history(20)
    brake = brakes_at(history)
    wait_for(
        lambda: any(state["stamp"] > brake.stamp + 0.3 for state in site.states(session)),
        10,
        "the record of the stop",
    )
    accepted = [
        c["stamp"] + c["age"]
        for state in site.states(session)
        for c in state.get("applied", [])
        if c["linear"] > 0.05
    ]
    delay = brake.stamp - max(moment for moment in accepted if moment < brake.stamp + STEP)
    late = giraff.computer.excuse(brake.stamp - delay, brake.stamp)
    assert delay <= DEADLINE + late, (
        f"told to stop {delay:.3f} s after the last accepted command, and the computer was"
        f" {late:.3f} s late"
    )
    stands_after_braking(giraff, history, brake)
    return delay


def stands_after_braking(giraff: Onlooker, history: list[Row], brake: Row) -> None:
    stood = next(row for row in history if row.stamp > brake.stamp and abs(row.linear) < 1e-3)
    needed, took = abs(brake.linear) / BRAKING, stood.stamp - brake.stamp
    late = giraff.computer.excuse(brake.stamp, stood.stamp)
    assert took <= needed + 0.1 + late, (
        f"stood {took:.2f} s after braking began, {needed:.2f} s were needed, and the computer was"
        f" {late:.2f} s late"
    )


def outcome(site, wanted: tuple[str, str], within: float = 60) -> None:
    wait_for(
        lambda: tuple(site.sessions()[-1][2:]) == wanted,
        within,
        f"{wanted} (it is {site.sessions()[-1][2:]})",
    )


def nothing_is_missing(
    site, session: str, last: float, lapses: tuple[float, float] | None = None
) -> list[dict]:
    """Every state of the session is in the record, once, until a stamp; what was lost on the way
    has been asked for again by then.

    States of a moment without a lease are nobody's.
    """

    def complete() -> list[dict] | None:
        states = site.states(session)
        numbers = [(state["boot"], state["seq"]) for state in states]
        assert len(set(numbers)) == len(numbers), "states are in the record twice"
        boots = {boot: sorted(seq for of, seq in numbers if of == boot) for boot, _ in numbers}
        stamps = {(state["boot"], state["seq"]): state["stamp"] for state in states}
        holes = [
            (stamps[boot, a], stamps[boot, b])
            for boot, seqs in boots.items()
            for a, b in pairwise(seqs)
            if b != a + 1
        ]
        whole = all(
            lapses is not None and lapses[0] - 1.0 < before and after < lapses[1] + 1.0
            for before, after in holes
        )
        return states if whole and max(state["stamp"] for state in states) >= last else None

    return wait_for(complete, 30, "a record without holes")


def turns(someone: Visitor, giraff: Onlooker, within: float = 30) -> None:
    """The visitor can turn the robot; a key that was down while the link came back has to be
    pressed again, as people do.
    """
    before = giraff.truth().theta
    deadline = time.monotonic() + patient(within)
    while abs(giraff.truth().theta - before) < 0.1:
        assert time.monotonic() < deadline, (
            f"no turn within {within} s (link {someone.page_data('link')}, way"
            f" {someone.page_data('transport')})"
        )
        someone.page.keyboard.down("ArrowLeft")
        someone.page.wait_for_timeout(1500)
        someone.page.keyboard.up("ArrowLeft")


def keeps_moving(giraff: Onlooker, since: float, until: float = float("inf")) -> None:
    """The base was told to move at every moment since then."""
    rows = [row for row in giraff.history(60) if since <= row.stamp < until]
    assert len(rows) > 100
    slow = [row.stamp for row in rows if row.commanded_linear < 0.1]
    # A page that is held up for longer than commands may be apart stops the robot, as it should.
    held_up = bool(slow) and giraff.computer.excuse(slow[0] - 1.0, slow[0]) > 0.1
    assert not slow or held_up, (
        f"told to stop {slow[0] - since:.2f} s after the process was killed, for"
        f" {len(slow) / 100:.2f} s"
    )


# --- the visitor's side ---------------------------------------------------------------------------


@pytest.mark.nightly
def test_a_page_that_dies_stops_the_robot_and_its_visitor_may_come_back(
    site, visitor, giraff, driver
):
    with contextlib.suppress(Exception):
        driver.page.goto("chrome://crash", timeout=2000)
    check_stop(site, giraff)
    outcome(site, ("reconnecting", ""), 20)
    session = site.sessions()[-1][0]
    driver.page = driver.new_page()
    driver.open(go=True)
    driver.wait_for_picture()
    outcome(site, ("driving", ""))
    assert site.sessions()[-1][0] == session
    turns(driver, giraff)


def test_a_tab_that_is_hidden_with_a_key_held_stops_the_robot(site, giraff, driver):
    driver.page.evaluate("""() => {
      Object.defineProperty(document, 'visibilityState', { value: 'hidden', configurable: true });
      Object.defineProperty(document, 'hidden', { value: true, configurable: true });
      document.dispatchEvent(new Event('visibilitychange'));
    }""")
    check_stop(site, giraff)
    time.sleep(1)
    assert standstill(giraff), "the held key moved the robot again"


def test_a_window_that_loses_focus_with_a_key_held_stops_the_robot(site, giraff, driver):
    driver.page.evaluate("window.dispatchEvent(new Event('blur'))")
    check_stop(site, giraff)
    time.sleep(1)
    assert standstill(giraff), "the held key moved the robot again"


def test_commands_that_no_longer_leave_the_page_stop_the_robot_though_the_picture_goes_on(
    site, visitor, giraff
):
    mute = visitor("mute")
    mute.context.add_init_script(MUFFLE)
    mute.page = mute.new_page()
    under_way(mute.drive(), giraff)
    mute.page.evaluate("window.muffled = true")
    check_stop(site, giraff)


@pytest.mark.nightly
def test_a_cable_that_is_pulled_stops_the_robot_and_the_visit_goes_on_when_it_is_back(
    tmp_path_factory, playwright, giraff, site
):
    with (
        namespace() as network,
        chromium(
            playwright, str(network.wrapper(tmp_path_factory.mktemp("bin"), CHROMIUM))
        ) as browser,
    ):
        far = Visitor(browser, site, "far", host=HERE)
        under_way(far.drive(), giraff)
        session = site.sessions()[-1][0]
        network.pull()
        check_stop(site, giraff)
        outcome(site, ("reconnecting", ""), 20)
        network.plug()
        outcome(site, ("driving", ""), 30)
        far.wait_for("link", "live", 30)
        far.page.keyboard.up("ArrowUp")
        turns(far, giraff)
        assert site.sessions()[-1][0] == session


# --- the robot's side -----------------------------------------------------------------------------


@pytest.mark.nightly
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
def test_an_agent_that_is_dead_or_stuck_leaves_the_stopping_to_the_base(
    site, giraff, driver, number
):
    session = site.sessions()[-1][0]
    at = time.time()
    site.send("giraff", number)
    sent = time.time()
    wait_for(lambda: standstill(giraff), 5, "a standing robot")
    history = [row for row in giraff.history(20) if row.stamp > at]
    # nobody tells the base anything any more
    brake = next(row for row in history if row.linear < 0.98 * history[0].linear)
    assert brake.stamp - sent <= WATCHDOG + 2 * STEP + giraff.computer.excuse(at, brake.stamp)
    stands_after_braking(giraff, history, brake)
    time.sleep(1)
    if number == signal.SIGSTOP:
        site.send("giraff", signal.SIGCONT)
        time.sleep(0.5)
        assert standstill(giraff), "commands from before moved the robot"
    else:
        site.processes.pop("giraff").wait()
        site.start("giraff")
    driver.page.keyboard.up("ArrowUp")
    driver.wait_for("link", "live", 60)
    turns(driver, giraff)
    outcome(site, ("driving", ""))
    assert site.sessions()[-1][0] == session
    states = nothing_is_missing(site, session, time.time() - 2)
    assert states[0]["stamp"] < at - 1


# --- the servers ----------------------------------------------------------------------------------


@pytest.mark.nightly
@pytest.mark.parametrize("part", ["session-manager", "broker", "web"])
def test_a_server_process_that_is_killed_and_started_again_does_not_interrupt_the_drive(
    site, visitor, giraff, part
):
    someone = under_way(visitor(f"during-{part}").drive(), giraff, slowly=True)
    session = site.sessions()[-1][0]
    renewal = site.renewal("giraff")
    wait_for(lambda: site.renewal("giraff") != renewal, 10, "a lease that was renewed just now")
    time.sleep(0.3)  # the robot has heard it
    since = time.time()
    if part == "session-manager":
        site.succeed(part, "session_manager_waiting")
    else:
        site.stop(part, signal.SIGKILL)
    if part == "broker":
        site.start_broker()
    elif part == "web":
        site.start(part)
        wait_for(site.web_answers, 20, "the web server")
    again = time.time()
    wait_for(
        lambda: any(state["stamp"] > again + 5 for state in site.states(session)),
        25,
        "a record that goes on",
    )
    # On a computer on which a broker needs longer than a lease lives, the robot stands until
    # somebody can renew it.
    lapses = (
        (since + LEASE - 1.0, again + 4.0)
        if part == "broker" and again - since > LEASE - 4.0
        else None
    )
    keeps_moving(giraff, since, lapses[0] if lapses else float("inf"))
    someone.page.keyboard.up("ArrowUp")
    wait_for(lambda: standstill(giraff), 5, "a standing robot")
    ended = time.time()
    states = nothing_is_missing(site, session, ended, lapses)
    assert states[0]["stamp"] < since
    wait_for(
        lambda: (
            someone.page.evaluate("document.getElementById('drive-page').dataset.phase")
            == "driving"
        ),
        20,
        "the page's visit",
    )
    someone.leave()
    outcome(site, ("ended", "completed"), 30)
