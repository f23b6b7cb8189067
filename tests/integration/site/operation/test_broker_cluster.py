"""A drive over a broker of three nodes, one of which is killed or frozen: the robot stops in time,
drives again through another node, and never has two drivers.

The visitors have no data channel, so that all control passes through the broker. Web process and
agent, and usually the session manager, are connected to the node that fails.
"""

import json
import time
import urllib.request
from dataclasses import dataclass

import pytest

from benchmarks.traffic.bases import Bases
from benchmarks.traffic.places import ROBOTS, SESSIONS, VISITORS
from benchmarks.traffic.verdicts import DrivePeriod, moved_alone, two_at_once
from benchmarks.traffic.worker import Hands
from tests.support.clustered_brokers.nats import NatsNodes
from tests.support.clustered_brokers.site import ClusterSite
from tests.support.host_jitter import watched
from tests.support.sessions.site import wait_for

pytestmark = [pytest.mark.broker, pytest.mark.soak]
MACHINES = ("127.0.0.11", "127.0.0.12", "127.0.0.13")
STOPS = 0.65  # s after the last command
AGAIN = 60.0  # s in which the robot drives again
FROZEN = 10.0  # s
STAYS = 300.0  # s that a visitor would drive: longer than the test
ROBOT = "giraff-2"


@dataclass
class Drive:
    """A driven robot with the records of its motion and sessions."""

    site: ClusterSite
    bases: Bases

    def spans(self):
        """Return the (since, until) of each motion, Unix time."""
        return self.bases.moves().get(ROBOT, [])

    def moved_since(self, moment):
        return sum(until - max(since, moment) for since, until in self.spans() if until > moment)

    def sessions(self):
        return [DrivePeriod(*row) for row in json.loads(self.site.django(SESSIONS))]


@pytest.fixture
def site(tmp_path):
    (tmp_path / "nats").mkdir()
    site = ClusterSite(tmp_path / "var", cluster=NatsNodes(tmp_path / "nats", MACHINES))
    try:
        site.prepare()
        token = json.loads(site.django(ROBOTS.format(names=[ROBOT])))[0][1]
        site.write_users()
        site.start_servers()
        site.token = token
        yield site
    finally:
        site.cluster.stop()
        site.stop_all()


@pytest.fixture
def drive(site, tmp_path):
    """Ana drives; Cy waits for the same robot, and would get it if Ana lost it."""
    with Bases() as bases, Hands("benchmarks.traffic.visitors") as visitors:
        words = ["--mqtt", site.mqtt_url, "--token", site.token, "--var", str(tmp_path / "agent")]
        robot = ["-m", "benchmarks.traffic.based_robot", ROBOT, *words, "--base", str(bases.port)]
        site.start(ROBOT, robot)
        wait_for(lambda: site.robot_is_online(ROBOT), 30, "the robot online")
        cookies = json.loads(site.django(VISITORS.format(names=["ana", "cy"])))
        visitors.ask(
            "add", [[f"{site.url}/ws/robots/{ROBOT}/", cookie] for cookie in cookies], STAYS
        )
        drive = Drive(site, bases)
        wait_for(lambda: drive.moved_since(0.0) > 5.0, 60, "a drive", drive.spans)
        yield drive
        visitors.ask("leave")


def queues_of(places):
    """Return the names of the queues that the cluster keeps for subscriptions at QoS 1."""
    found = set()
    for place in places:
        url = f"http://{place.host}:{place.monitor}/jsz?accounts=true&streams=true&consumers=true"
        with urllib.request.urlopen(url, timeout=5) as answer:
            accounts = json.load(answer)["account_details"]
        found |= {
            queue["name"]
            for account in accounts
            for stream in account["stream_detail"]
            if stream["name"] == "$MQTT_msgs"
            for queue in stream.get("consumer_detail", ())
        }
    return found


def test_driven_robot_needs_no_queue_of_the_cluster(drive):
    """The five queues are the session manager's, for rare messages."""
    assert len(queues_of(drive.site.cluster.places)) == 5


def judge(drive, failed_at, late, record):
    """Measure stop and recovery; check that there was one driver, and no motion without one."""
    wait_for(lambda: drive.moved_since(failed_at + STOPS) > 5.0, AGAIN, "a robot that drives again")
    spans, sessions = drive.spans(), drive.sessions()
    last = max(until for since, until in spans if since <= failed_at)
    again = min(since for since, _ in spans if since > failed_at)
    record("stopped_after_s", round(last - failed_at, 2))
    record("drove_again_after_s", round(again - failed_at, 2))
    record("sessions", [session.outcome for session in sessions])
    assert last - failed_at <= STOPS + late
    assert not two_at_once(sessions)
    assert not moved_alone({ROBOT: spans}, sessions, late)


def test_robot_stops_in_time_and_drives_again_by_another_node_after_a_kill(drive, record_property):
    with watched() as jitter:
        failed_at = time.time()
        drive.site.cluster.nodes[0].kill()
        wait_for(lambda: drive.moved_since(failed_at + STOPS) > 5.0, AGAIN, "another drive")
        judge(drive, failed_at, jitter.excuse(failed_at, time.time()), record_property)


def test_node_frozen_for_ten_seconds_leads_to_no_second_driver(drive, record_property):
    node = drive.site.cluster.nodes[0]
    with watched() as jitter:
        failed_at = time.time()
        node.freeze()
        wait_for(lambda: time.time() > failed_at + FROZEN, FROZEN, "the end of the freeze")
        node.thaw()
        wait_for(lambda: drive.moved_since(failed_at + FROZEN) > 5.0, AGAIN, "another drive")
        judge(drive, failed_at, jitter.excuse(failed_at, time.time()), record_property)
