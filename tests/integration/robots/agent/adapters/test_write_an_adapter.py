"""The page about writing an adapter, executed: its two blocks are a robot, and pass the conformance
suite.
"""

import asyncio
import re

import pytest

from robots.agent.adapters import registry
from robots.agent.robot_interface import AdapterError
from robots.agent.safety.collision_monitor import monitor_of
from tests.support.paths import ROOT
from tests.support.rca_conformance import RcaConformance
from tests.support.rca_world import RcaRig

PAGE = ROOT / "docs" / "howto" / "write-an-adapter.md"


def block(language):
    (found,) = re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    return found


class Rosie(RcaRig, asyncio.DatagramProtocol):
    """The base of the page: a simulated rhodon that speaks UDP."""

    series = "rhodon"

    def __init__(self, directory):
        super().__init__()
        self.port, self.transport, self.peer = 0, None, None
        self.adapter_file, self.profile_file = directory / "rosie.py", directory / "rosie.toml"
        self.adapter_file.write_text(block("python"), encoding="utf-8")
        self.profile_file.write_text(block("toml"), encoding="utf-8")

    def adapter(self, **options):
        return registry.create(
            str(self.adapter_file),
            str(self.profile_file),
            {"host": "127.0.0.1", "port": str(self.port), **options},
        )

    async def up(self):
        self.transport, _ = await self.loop.create_datagram_endpoint(
            lambda: self, local_addr=("127.0.0.1", self.port)
        )
        self.port = self.transport.get_extra_info("sockname")[1]

    async def down(self):
        self.transport.close()
        self.peer = None

    def connection_made(self, transport):
        pass

    def error_received(self, error):
        self.peer = None

    def datagram_received(self, data, address):
        self.peer = address
        self.world.drive(*map(float, data.split()))

    async def say(self, count):
        if count % 3 == 0 and self.peer:
            sim = self.world.sim
            values = (*sim.odometry, sim.motion.linear, sim.motion.angular, sim.voltage())
            self.transport.sendto(" ".join(f"{value:.5f}" for value in values).encode(), self.peer)


class TestRosie(RcaConformance):
    def make_rig(self, directory):
        return Rosie(directory)


def test_what_the_page_promises_of_a_laser_is_so(tmp_path):
    rosie = tmp_path / "rosie.py"
    rosie.write_text(
        block("python").replace("options.watchdog)", 'options.watchdog, own=("scan",))'),
        encoding="utf-8",
    )
    profile = tmp_path / "rosie.toml"
    profile.write_text(block("toml") + "\n[laser]\nx = 0.1\n", encoding="utf-8")
    adapter = registry.autonomous(registry.create(str(rosie), str(profile)))
    assert {"goto", "dock"} <= set(adapter.profile.capabilities)
    assert monitor_of(adapter.profile) is not None, "assistance"


def test_what_the_page_promises_of_sonars_and_a_bumper_is_so(tmp_path):
    rosie = tmp_path / "rosie.py"
    rosie.write_text(block("python"), encoding="utf-8")
    profile = tmp_path / "rosie.toml"
    profile.write_text(
        "bumper = true\n" + block("toml") + "\n[[sonars]]\nx = 0.25\ny = 0.0\ntheta = 0.0\n",
        encoding="utf-8",
    )
    adapter = registry.create(str(rosie), str(profile))
    assert registry.autonomous(adapter) is adapter, "no map can be found by that"
    assert monitor_of(adapter.profile) is not None, "assistance"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("import no_such_library", "no_such_library"),
        ("def create(:", "invalid syntax"),
        ("x = 1", "has no create"),
    ],
)
def test_a_file_that_is_no_adapter_is_refused_with_the_reason(tmp_path, text, sentence):
    file = tmp_path / "mine.py"
    file.write_text(text)
    with pytest.raises(AdapterError, match=sentence):
        registry.create(str(file), "giraff")


def test_a_file_that_is_not_there_is_named():
    with pytest.raises(AdapterError, match=r"no_such\.py"):
        registry.create("./no_such.py", "giraff")
