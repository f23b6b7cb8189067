"""Faults of page, tab, network, agent and servers leave the robot safe. Every test measures the
commands of the base and its motion.

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
    """A robot in the corridor with more than six metres ahead of it and without a driver."""
    over = lambda: all(state == "ended" for _, _, state, _ in site.sessions())
    wait_for(over, 60, "the end of earlier visits")
    with site.robot("giraff", "--start", "corridor-centre") as onlooker:
        onlooker.computer = computer
        yield onlooker


@pytest.fixture
def driver(visitor, giraff):
    return driving_steadily(visitor("anna").drive(), giraff)


def driving_steadily(visitor: Visitor, giraff: Onlooker, *, slowly: bool = False) -> Visitor:
    visitor.wait_for("link", "live")
    if slowly:
        visitor.page.locator("[data-action=speed-0]").click()
    visitor.hold("ArrowUp", lambda: steady(giraff), 15, "a steady speed")
    return visitor


def steady(giraff: Onlooker) -> bool:
    speeds = [row.commanded_linear for row in giraff.history(0.5)]
    return len(speeds) > 20 and min(speeds) > 0.1 and max(speeds) - min(speeds) < 0.001


def standstill(giraff: Onlooker) -> bool:
    return abs(giraff.truth().linear) < 1e-3


def brakes_at(history: list[Row]) -> Row:
    """Return the first row of the last braking: the command stays below the steady speed."""
    speed = max(row.commanded_linear for row in history)
    last = max(index for index, row in enumerate(history) if row.commanded_linear > 0.98 * speed)
    return history[last + 1]


def check_stop(site, giraff: Onlooker) -> float:
    """Assert that the base was commanded to stop in time after the last accepted command, and came
    to rest within its braking time. Return the delay of the command.
    """
    wait_for(lambda: standstill(giraff), 5, "a standing robot")
    session = site.sessions()[-1][0]
    history = giraff.history(20)
    brake = brakes_at(history)
    recorded = lambda: any(one["stamp"] > brake.stamp + 0.3 for one in site.states(session))
    wait_for(recorded, 10, "the record of the stop")
    accepted = [
        c["stamp"] + c["age"]
        for state in site.states(session)
        for c in state.get("applied", [])
        if c["linear"] > 0.05
    ]
    delay = brake.stamp - max(moment for moment in accepted if moment < brake.stamp + STEP)
    late = giraff.computer.excuse(brake.stamp - delay, brake.stamp)
    assert delay <= DEADLINE + late, f"stopped after {delay:.3f} s, computer {late:.3f} s late"
    stands_after_braking(giraff, history, brake)
    return delay


def stands_after_braking(giraff: Onlooker, history: list[Row], brake: Row) -> None:
    stood = next(row for row in history if row.stamp > brake.stamp and abs(row.linear) < 1e-3)
    needed, took = abs(brake.linear) / BRAKING, stood.stamp - brake.stamp
    late = giraff.computer.excuse(brake.stamp, stood.stamp)
    assert took <= needed + 0.1 + late, f"{took:.2f} s, not {needed:.2f}, {late:.2f} s late"


def outcome(site, wanted: tuple[str, str], within: float = 60) -> None:
    wait_for(lambda: tuple(site.sessions()[-1][2:]) == wanted, within, f"{wanted}")


def nothing_is_missing(
    site, session: str, last: float, lapses: tuple[float, float] | None = None
) -> list[dict]:
    """Every state of the session is in the record, once, until a stamp; lost ones have been asked
    for again by then. States from a time without a lease belong to no session.
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


def turns(visitor: Visitor, giraff: Onlooker, within: float = 30) -> None:
    """The visitor can turn the robot; a key held while the link came back is pressed again."""
    before = giraff.truth().theta
    deadline = time.monotonic() + patient(within)
    while abs(giraff.truth().theta - before) < 0.1:
        state = [visitor.page_data(name) for name in ("link", "transport")]
        assert time.monotonic() < deadline, f"no turn within {within} s: {state}"
        visitor.page.keyboard.down("ArrowLeft")
        visitor.page.wait_for_timeout(1500)
        visitor.page.keyboard.up("ArrowLeft")


def keeps_moving(giraff: Onlooker, since: float, until: float = float("inf")) -> None:
    rows = [row for row in giraff.history(60) if since <= row.stamp < until]
    assert len(rows) > 100
    slow = [row.stamp for row in rows if row.commanded_linear < 0.1]
    # A page that is held up for longer than commands may be apart stops the robot, as it should.
    held_up = bool(slow) and giraff.computer.excuse(slow[0] - 1.0, slow[0]) > 0.1
    assert not slow or held_up, f"stopped after {slow[0] - since:.2f} s for {len(slow) / 100} s"


# --- the visitor's side ---------------------------------------------------------------------------


@pytest.mark.nightly
def test_a_page_that_crashes_stops_the_robot_and_its_visitor_can_return(site, giraff, driver):
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


HIDE = """() => {
  Object.defineProperty(document, 'visibilityState', { value: 'hidden', configurable: true });
  Object.defineProperty(document, 'hidden', { value: true, configurable: true });
  document.dispatchEvent(new Event('visibilitychange'));
}"""
BLUR = "window.dispatchEvent(new Event('blur'))"


@pytest.mark.parametrize("event", [HIDE, BLUR], ids=["hidden", "blur"])
def test_a_tab_that_is_hidden_or_loses_focus_while_a_key_is_held_stops_the_robot(
    site, giraff, driver, event
):
    driver.page.evaluate(event)
    check_stop(site, giraff)
    time.sleep(1)
    assert standstill(giraff), "the held key moved the robot again"


def test_the_robot_stops_when_commands_no_longer_leave_the_page(site, visitor, giraff):
    mute = visitor("mute")
    mute.context.add_init_script(MUFFLE)
    mute.page = mute.new_page()
    driving_steadily(mute.drive(), giraff)
    mute.page.evaluate("window.muffled = true")
    check_stop(site, giraff)


@pytest.mark.nightly
def test_a_pulled_cable_stops_the_robot_and_the_visit_resumes_once_it_is_back(
    tmp_path_factory, playwright, giraff, site
):
    with contextlib.ExitStack() as stack:
        network = stack.enter_context(namespace())
        wrapper = network.wrapper(tmp_path_factory.mktemp("bin"), CHROMIUM)
        browser = stack.enter_context(chromium(playwright, str(wrapper)))
        far = Visitor(browser, site, "far", host=HERE)
        driving_steadily(far.drive(), giraff)
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
def test_the_base_stops_by_itself_when_the_agent_is_killed_or_stopped(site, giraff, driver, number):
    session = site.sessions()[-1][0]
    at = time.time()
    site.send("giraff", number)
    sent = time.time()
    wait_for(lambda: standstill(giraff), 5, "a standing robot")
    history = [row for row in giraff.history(20) if row.stamp > at]
    # the base gets no more commands
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
def test_a_drive_goes_on_while_a_server_process_is_killed_and_restarted(
    site, visitor, giraff, part
):
    someone = driving_steadily(visitor(f"during-{part}").drive(), giraff, slowly=True)
    session = site.sessions()[-1][0]
    renewal = site.renewal("giraff")
    wait_for(lambda: site.renewal("giraff") != renewal, 10, "a lease that was renewed just now")
    time.sleep(0.3)  # until the robot has it
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
    goes_on = lambda: any(state["stamp"] > again + 5 for state in site.states(session))
    wait_for(goes_on, 25, "a record that goes on")
    # If the broker needs longer to start than a lease lasts, the robot stops until it is renewed.
    is_late = part == "broker" and again - since > LEASE - 4.0
    lapses = (since + LEASE - 1.0, again + 4.0) if is_late else None
    keeps_moving(giraff, since, lapses[0] if lapses else float("inf"))
    someone.page.keyboard.up("ArrowUp")
    wait_for(lambda: standstill(giraff), 5, "a standing robot")
    ended = time.time()
    states = nothing_is_missing(site, session, ended, lapses)
    assert states[0]["stamp"] < since
    someone.wait_for("phase", "driving", 20)
    someone.leave()
    outcome(site, ("ended", "completed"), 30)
