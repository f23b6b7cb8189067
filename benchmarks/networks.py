"""Every network of a visitor against every network of a robot: which route they find, how soon
there is a picture, how long a round trip takes.

Linux, as root. The networks are namespaces (tests/support/programs/networks.py). In the internet
stands the server of docs/howto/run-a-server.md, with the files of deploy/: nginx with TLS on 443,
Mosquitto, coturn at a second address with TLS on 443, PostgreSQL, Redis. Behind each visitor's
router runs a Chromium, behind the robot's its agent. A cell is one visit: take the robot, see it,
turn it.

`python -m benchmarks networks`, or with some of the networks: `python -m benchmarks.networks
--visitors "no UDP" --robots open`.
"""

import argparse
import base64
import contextlib
import hashlib
import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

from playwright.sync_api import Browser, Playwright, sync_playwright

from benchmarks.table import RESULTS
from tests.support.browsers.chromium import CHROMIUM
from tests.support.browsers.visitor import Visitor, chromium
from tests.support.programs.coturn import SECRET, Coturn, deployed_limits
from tests.support.programs.networks import (
    HOME,
    LAN_SERVER,
    NO_UDP,
    OPEN,
    RELAY,
    SERVER,
    STRICT,
    WEB_ONLY,
    Computer,
    Internet,
    internet,
)
from tests.support.programs.server import PORTS, Server, running_server
from tests.support.sessions.site import ROOT, free_port, wait_for

NETWORKS = {"open": OPEN, "NAT": HOME, "strict NAT": STRICT, "no UDP": NO_UDP, "only 443": WEB_ONLY}
LAN = "LAN"
PATIENCE, LATE = 15.0, 5.0  # s for any picture, and for a direct one after that
TURNING = 2500  # ms; two network samples and some states
TURNS_WITHIN = 10.0  # s
# Keeps hold of the page's connections, whose statistics say which way the packets take. The page
# itself hides them from everybody.
KEEP = """window.links = [];
window.RTCPeerConnection = class extends RTCPeerConnection {
  constructor(...terms) { super(...terms); window.links.push(this); }
};"""
PAIR = """async () => {
  const link = window.links.find(({ connectionState }) => connectionState === 'connected');
  const report = new Map(link ? await link.getStats() : []);
  const transport = [...report.values()].find(
    ({ type, selectedCandidatePairId }) => type === 'transport' && selectedCandidatePairId,
  );
  const pair = transport && report.get(transport.selectedCandidatePairId);
  if (!pair) return undefined;
  const mine = report.get(pair.localCandidateId);
  const theirs = report.get(pair.remoteCandidateId).candidateType;
  return mine && { mine: mine.candidateType, by: mine.relayProtocol ?? '', theirs };
}"""
SINCE = "(performance.now() - performance.getEntriesByName('drive:taking')[0].startTime) / 1000"
FIRST_FRAME = (
    "(performance.getEntriesByName('drive:first-frame')[0]?.startTime -"
    " performance.getEntriesByName('drive:taking')[0].startTime) / 1000"
)
RECORD = """
import json
from sessions.models import NetworkSample, Session, StateChunk
drive = Session.objects.order_by("-queued_at").first()
chunks = StateChunk.objects.filter(session=drive).order_by("first_stamp")
states = [state for chunk in chunks for state in chunk.states]
samples = NetworkSample.objects.filter(session=drive)
timed = [sample.data for sample in samples if sample.data.get("roundTrip") and sample.data["way"]]
trips = [1000.0 * data["roundTrip"] for data in timed]
turned = any(state.get("applied") and abs(state["velocity"]["angular"]) > 0.05 for state in states)
print(json.dumps({"trips": sorted(trips), "turned": turned}))
"""


@dataclass(frozen=True)
class NetworkPairResult:
    """One visit: times in s and ms; `route` is the visitor's end and the robot's, or the server for
    pictures that come one by one.
    """

    visitor: str
    robot: str
    relay: bool
    route: str
    first_picture: float
    round_trip: float
    drove: bool

    @property
    def met(self) -> bool:
        return self.route != NOTHING and self.drove


NOTHING = "nothing"


class NetworkedAgent:
    """The agent of the simulated giraff, on a computer of one of the networks."""

    def __init__(self, server: Server, computer: Computer, address: str, folder: Path) -> None:
        self._log = (folder / f"{computer.name}.log").open("wb")
        words = [
            "-m",
            "robots.agent",
            "giraff",
            "--server",
            f"https://{address}",
            "--ca",
            server.files["fullchain.pem"],
        ]
        words += [
            "--adapter",
            "simulator",
            "--var",
            folder / computer.name,
            "--option",
            "start=corridor-centre",
        ]
        environment = {
            **os.environ,
            "TELEPRESENCE_TOKEN": server.token,
            "SSL_CERT_FILE": str(folder / "relay/fullchain.pem"),
        }
        self._process = subprocess.Popen(
            computer.command(sys.executable, *map(str, words)),
            cwd=ROOT,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=subprocess.STDOUT,
        )

    def stop(self) -> None:
        self._process.send_signal(signal.SIGTERM)
        self._process.wait(60)
        self._log.close()


@contextlib.contextmanager
def robot_in(server: Server, computer: Computer, address: str, folder: Path) -> Iterator[None]:
    robot = NetworkedAgent(server, computer, address, folder)
    try:
        wait_for(lambda: connection(server) == "ONLINE", 40, f"the robot in {computer.name}")
        yield
    finally:
        robot.stop()
        wait_for(lambda: connection(server) != "ONLINE", 20, "the robot's goodbye")


def connection(server: Server) -> str:
    return server.site.django(
        "from robots.models import RobotPresence as Presence;"
        " print(Presence.objects.get(robot__name='giraff').connection)"
    ).strip()


def measure(
    browser: Browser, server: Server, address: str, names: tuple[str, str], *, relay: bool
) -> NetworkPairResult:
    """Open the drive page, take the robot and turn it; return the connection and its delays."""
    anna = Visitor(browser, server.site, "anna", url=f"https://{address}", ignore_https_errors=True)
    anna.context.add_init_script(KEEP)
    first, route, drove = float("inf"), NOTHING, False
    try:
        anna.open(go=True)
        first, route = look(anna)
        wait_for(lambda: turn(anna, server), TURNS_WITHIN, "a turn of the robot")
        drove = True
        anna.leave()
    except AssertionError as problem:
        print(f"  {names}: {problem}", file=sys.stderr)
    finally:
        anna.close()
    trips = record(server)["trips"]
    return NetworkPairResult(
        *names, relay, route, first, trips[len(trips) // 2] if trips else float("inf"), drove
    )


def turn(visitor: Visitor, server: Server) -> bool:
    """Hold a key for a moment, and tell whether the robot has been seen to turn by now."""
    visitor.page.keyboard.down("ArrowLeft")
    visitor.page.wait_for_timeout(TURNING)
    visitor.page.keyboard.up("ArrowLeft")
    return bool(record(server)["turned"])


def record(server: Server) -> Any:
    """Return what the server has recorded of the newest drive: round trips in ms, and whether
    commands arrived and the robot turned.
    """
    return json.loads(server.site.django(RECORD))


def look(visitor: Visitor) -> tuple[float, str]:
    """Return the seconds from taking the robot to a picture of any kind, and the way it came once
    that settled.
    """
    page = visitor.page
    wait_for(lambda: page.locator("#drive-page[data-playing]").count(), PATIENCE, "a picture")
    first = float(page.evaluate(SINCE))
    live = page.locator("#drive-page[data-playing][data-link=live]:not([data-slow])")
    try:
        pair = wait_for(lambda: live.count() and page.evaluate(PAIR), LATE, "live video")
    except AssertionError:
        return first, "server" if page.locator("#drive-page[data-slow]").count() else NOTHING
    return min(first, float(page.evaluate(FIRST_FRAME))), route_of(pair)


def route_of(pair: dict[str, str]) -> str:
    mine = f"TURN/{pair['by'].upper()}" if pair["mine"] == "relay" else pair["mine"]
    return f"{mine} – {'TURN' if pair['theirs'] == 'relay' else pair['theirs']}"


def fingerprint(certificate: Path) -> str:
    """Return what Chromium calls a certificate that it is to trust: the SHA-256 of its public key,
    base64.
    """
    key = subprocess.run(
        ["openssl", "x509", "-in", certificate, "-pubkey", "-noout"],
        check=True,
        capture_output=True,
    ).stdout
    raw = subprocess.run(
        ["openssl", "pkey", "-pubin", "-outform", "der"], input=key, check=True, capture_output=True
    ).stdout
    return base64.b64encode(hashlib.sha256(raw).digest()).decode()


def relay_settings(*, relay: bool) -> dict[str, str]:
    """Return the site's settings: an address server, and the relay by UDP, by TCP and by TLS on
    443, or none.
    """
    turn = (
        f"turn:{RELAY}:3478?transport=udp,turn:{RELAY}:3478?transport=tcp,"
        f"turns:{RELAY}:443?transport=tcp"
        if relay
        else ""
    )
    return {
        "STUN_URLS": f"stun:{RELAY}:3478",
        "TURN_URLS": turn,
        "TURN_SECRET": SECRET if relay else "",
    }


@contextlib.contextmanager
def server_at(folder: Path, address: str, settings: dict[str, str]) -> Iterator[Server]:
    """The server, known by its address."""
    ports = {name: free_port() for name in PORTS} | {"https": 443, "http": 80, "mqtts": 8883}
    public = {"MQTT_PUBLIC_URL": "mqtts://{host}:8883,wss://{host}/mqtt"}
    folder.mkdir()
    with running_server(
        folder, host=address, bind=address, ports=ports, settings=settings | public
    ) as server:
        server.site.run("manage.py", "collectstatic", "--noinput", "-v", "0")
        yield server


class Matrix:
    """All cells of one server; prints each as it comes."""

    def __init__(
        self,
        net: Internet,
        folder: Path,
        playwright: Playwright,
        wanted: tuple[list[str], list[str]],
    ) -> None:
        self._net, self._folder, self._playwright = net, folder, playwright
        self.visitors, self.robots = wanted
        self.cells: list[NetworkPairResult] = []
        self._stack = contextlib.ExitStack()
        self._browsers: dict[str, Browser] = {}
        self._computers: dict[str, Computer] = {}

    def __enter__(self) -> Self:
        self._stack.__enter__()
        return self

    def __exit__(self, *problem: object) -> None:
        self._stack.close()

    def fill(self, server: Server, *, relay: bool) -> None:
        for robot in self.robots:
            with robot_in(server, self._computer(f"robot-{robot}", robot), SERVER, self._folder):
                for visitor in self.visitors:
                    self.add(
                        measure(
                            self._browser(visitor), server, SERVER, (visitor, robot), relay=relay
                        )
                    )

    def add(self, cell: NetworkPairResult) -> None:
        self.cells.append(cell)
        print(row(cell), flush=True)

    def _computer(self, name: str, network: str) -> Computer:
        if name not in self._computers:
            place = name.replace(" ", "-").lower()
            self._computers[name] = (
                self._net.join_lan(place)
                if network == LAN
                else self._net.join(place, NETWORKS[network])
            )
        return self._computers[name]

    def _browser(self, network: str) -> Browser:
        if network not in self._browsers:
            computer = self._computer(f"visitor-{network}", network)
            trusted = fingerprint(self._folder / "relay/fullchain.pem")
            program = computer.wrapper(
                self._folder, f"{CHROMIUM} --ignore-certificate-errors-spki-list={trusted}"
            )
            self._browsers[network] = self._stack.enter_context(
                chromium(self._playwright, str(program))
            )
        return self._browsers[network]

    def fill_lan(self, server: Server) -> None:
        """Have a visitor visit a robot where both and the server are on one cable, and nothing
        else.
        """
        with robot_in(server, self._computer("robot-lan", LAN), LAN_SERVER, self._folder):
            self.add(measure(self._browser(LAN), server, LAN_SERVER, (LAN, LAN), relay=False))


def row(cell: NetworkPairResult) -> str:
    relay = "relay" if cell.relay else "no relay"
    verdict = "" if cell.met else "   MISSED"
    return (
        f"  {cell.visitor:<11}{cell.robot:<11}{relay:<10}{cell.route:<22}"
        f"{cell.first_picture:7.2f} s {cell.round_trip:7.1f} ms{verdict}"
    )


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--visitors", nargs="*", choices=NETWORKS, default=list(NETWORKS))
    parser.add_argument("--robots", nargs="*", choices=NETWORKS, default=list(NETWORKS))
    parser.add_argument(
        "--servers",
        nargs="*",
        choices=("relay", "no relay", "lan"),
        default=["relay", "no relay", "lan"],
    )
    wanted = parser.parse_args()
    print(
        f"  {'visitor':<11}{'robot':<11}{'server':<10}{'route':<22}{'first':>9} {'round trip':>10}"
    )
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that cleanup runs
    with contextlib.ExitStack() as stack:
        folder = Path(
            stack.enter_context(tempfile.TemporaryDirectory(prefix="telepresence-networks-"))
        )
        net = stack.enter_context(internet())
        (folder / "relay").mkdir()
        stack.enter_context(
            Coturn(folder / "relay", RELAY, ports=(3478, 443), limits=deployed_limits())
        )
        matrix = stack.enter_context(
            Matrix(
                net,
                folder,
                stack.enter_context(sync_playwright()),
                (wanted.visitors, wanted.robots),
            )
        )
        for number, kind in zip(itertools.count(), wanted.servers):
            address = LAN_SERVER if kind == "lan" else SERVER
            with server_at(
                folder / f"server-{number}", address, relay_settings(relay=kind == "relay")
            ) as server:
                if kind == "lan":
                    matrix.fill_lan(server)
                else:
                    matrix.fill(server, relay=kind == "relay")
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "networks.json").write_text(
        json.dumps({"cells": [asdict(cell) for cell in matrix.cells]}, indent=1)
    )
    return sum(not cell.met for cell in matrix.cells)


if __name__ == "__main__":
    sys.exit(main())
