"""OpenMORA's variables in a MOOSDB, a double or with MOOSDB=host:port a real one: the conformance
suite, and the wire format.
"""

import asyncio
import math
import os

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from robots.agent.adapters import registry
from robots.agent.adapters.moos import openmora, wire
from robots.agent.adapters.moos.client import MoosClient
from robots.agent.adapters.moos.wire import Mail
from robots.agent.robot_interface import AdapterError
from robots.api.geometry import Pose2D
from robots.api.messages import Dock, Goto
from tests.support.architectures.adapter_conformance import some, wait_for
from tests.support.architectures.moos_robot import NODES, VIA, MoosRig
from tests.support.architectures.moosdb import MoosDb
from tests.support.architectures.rca_conformance import (
    RcaConformance,
    cancelled,
    ended,
    heard,
    stays,
)

REAL = os.environ.get("MOOSDB", "")


class TestGiraff(RcaConformance):
    def make_rig(self, directory):
        return MoosRig("giraff", REAL)

    @pytest.mark.nightly
    async def test_end_of_an_earlier_journey_does_not_end_this_one(self, adapter):
        # the second time, the variable still holds the end of the first
        for number in range(2):
            goal = self.rig.world.truth.x + 0.35, self.rig.world.truth.y
            await adapter.start(Goto(action_id=f"g{number}", stamp=0.0, x=goal[0], y=goal[1]))
            assert (await heard(adapter, ended(f"g{number}")))[-1].status == "FINISHED"
            assert abs(self.rig.world.truth.x - goal[0]) < 0.3
            await adapter.close()
            await adapter.connect()

    @pytest.mark.nightly
    async def test_goto_a_place_ends_with_its_plan_and_not_at_the_first_node(self, adapter):
        for number in range(2):
            await adapter.start(Goto(action_id=f"g{number}", stamp=0.0, place="Sofa"))
            assert (await heard(adapter, ended(f"g{number}"), 20.0))[-1].status == "FINISHED"
            assert math.dist(self.rig.world.truth[:2], NODES["Sofa"]) < 0.3
            self.rig.reset()
            await wait_for(adapter, lambda s: s.pose.x < NODES["Door"][0])

    async def test_plan_that_ends_elsewhere_has_failed(self, adapter, monkeypatch):
        monkeypatch.setattr("robots.agent.adapters.moos.adapter.LANDING", 0.5)
        monkeypatch.setitem(VIA, "Sofa", None)
        # without a route to it, the planner still reports that the plan is finished
        monkeypatch.delitem(NODES, "Sofa")
        await wait_for(adapter, lambda _: adapter._place == "Door")
        await adapter.start(Goto(action_id="g", stamp=0.0, place="Sofa"))
        last = (await heard(adapter, ended("g")))[-1]
        assert (last.status, last.reason) == ("FAILED", "stopped_short")

    async def test_motion_that_openmora_starts_is_cancelled(self, adapter):
        await wait_for(adapter, lambda _: adapter._controller)
        self.rig.resume(self.rig.world.truth.compose(Pose2D(2.0, 0.0, 0.0)))
        # it may be cancelled before the next state
        await wait_for(adapter, lambda _: self.rig.world.kind == "goto")
        await wait_for(adapter, lambda _: self.rig.world.journey != "running")
        await self.has_stopped()

    async def test_plan_that_starts_after_its_cancel_is_cancelled_until_it_ends(self, adapter):
        self.rig.world.accept_after = 1.5
        await adapter.start(Goto(action_id="g", stamp=0.0, place="Sofa"))
        assert await cancelled(adapter, "g") > 2
        await self.has_stopped()
        await stays(self.rig, 2.0)

    async def test_docking_that_never_begins_is_cancelled(self, near_dock, monkeypatch):
        monkeypatch.setattr(openmora, "SETTING_OUT", 1.0)
        self.rig.world.accept_after = 60.0
        before = self.rig.world.cancels
        await near_dock.start(Dock(action_id="d", stamp=0.0))
        await wait_for(near_dock, lambda _: self.rig.world.cancels > before + 1)
        assert near_dock.pending_actions.of("d").failure == "does_not_start"

    @pytest.mark.parametrize("kind", ["goto", "dock"])
    async def test_journey_that_openmora_gives_up_has_failed(self, near_dock, kind, monkeypatch):
        monkeypatch.setattr("robots.agent.adapters.moos.adapter.GIVEN_UP", 1.0)
        goal = self.rig.world.truth.compose(Pose2D(-1.0, 0.0, 0.0))
        goto = Goto(action_id="a", stamp=0.0, x=goal.x, y=goal.y)
        await near_dock.start(goto if kind == "goto" else Dock(action_id="a", stamp=0.0))
        await wait_for(near_dock, lambda _: near_dock.pending_actions.drive.seen_running)
        self.rig.world.hung = True
        self.rig.give_up()
        last = (await heard(near_dock, ended("a")))[-1]
        assert (last.status, last.reason) == ("FAILED", "stopped_short")

    async def test_bumpers_count_each_contact_once(self, adapter):
        before = (await some(adapter.states(), 1))[0].contacts
        self.rig.bumped = 1.0
        await wait_for(adapter, lambda s: s.contacts == before + 1)
        self.rig.bumped = 0.0
        assert (await some(adapter.states(), 10))[-1].contacts == before + 1

    async def test_second_agent_of_the_same_name_is_refused_with_the_reason(self, adapter):
        await some(adapter.states(), 1)
        with pytest.raises(AdapterError, match="already exists"):
            await self.make().connect()


# --- the client -----------------------------------------------------------------------------------


@pytest.mark.nightly
async def test_idle_client_is_kept_because_it_sends_timing_messages(monkeypatch):
    # longer than a busy machine delays a process
    monkeypatch.setattr("tests.support.architectures.moosdb.SILENCE", 2.0)
    monkeypatch.setattr("robots.agent.adapters.moos.client.BEAT", 0.1)
    db, lost = MoosDb(), []
    await db.start()
    client = MoosClient("quiet", "127.0.0.1", db.port, lambda _: None, lost.append)
    await client.connect()
    await asyncio.sleep(4.5)  # more than twice SILENCE
    assert "quiet" in db.clients
    assert lost == []
    await client.close()
    await db.stop()


@pytest.mark.parametrize(
    "answer",
    [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n", wire.pack([Mail(wire.WELCOME, text="old")])],
)
async def test_another_server_at_the_address_is_reported(answer):
    async def serve(reader, writer):
        await reader.read(100)
        writer.write(answer)
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    adapter = registry.create("moos", "giraff", {"port": server.sockets[0].getsockname()[1]})
    with pytest.raises(AdapterError, match="MOOSDB"):
        await adapter.connect()
    server.close()


async def test_missing_database_is_reported():
    with pytest.raises(AdapterError, match=r"the MOOSDB at 127\.0\.0\.1:1 does not answer"):
        await registry.create("moos", "giraff", {"port": "1"}).connect()


async def test_missing_variable_of_the_robot_is_reported(monkeypatch):
    monkeypatch.setattr("robots.agent.adapters.common.remote_adapter.FIRST_READING", 0.2)
    db = MoosDb()
    await db.start()
    with pytest.raises(AdapterError, match="has not sent LOCALIZATION"):
        await registry.create("moos", "giraff", {"port": db.port}).connect()
    await db.stop()


# --- the wire -------------------------------------------------------------------------------------


def test_packet_has_the_bytes_of_the_format_description():
    packet = wire.pack([Mail(wire.NOTIFY, "V", 1.5, 2.0, "me", number=7)])
    message = (
        b"\x39\x00\x00\x00"
        b"\x07\x00\x00\x00"
        b"N"
        b"D"
        b"\x02\x00\x00\x00me"
        b"\x00\x00\x00\x00"
        b"\x00\x00\x00\x00"
        b"\x01\x00\x00\x00V"
        b"\x00\x00\x00\x00\x00\x00\x00\x40"
        b"\x00\x00\x00\x00\x00\x00\xf8\x3f"
        b"\x00\x00\x00\x00\x00\x00\xf0\xbf"
        b"\x00\x00\x00\x00"
    )
    header = (9 + len(message)).to_bytes(4, "little") + b"\x01\x00\x00\x00" + b"\x00"
    assert packet == header + message


mails = st.builds(
    Mail,
    type=st.sampled_from([wire.NOTIFY, wire.REGISTER, wire.DATA]),
    key=st.text(max_size=6),
    value=st.one_of(st.floats(allow_nan=False), st.text(max_size=6), st.binary(max_size=6)),
    time=st.floats(0, 1e10),
    source=st.just("me"),
)


# a busy computer is slow at everything
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(mails, max_size=3))
def test_packed_messages_are_unpacked(sent):
    packet = wire.pack(sent)
    size, count = wire.body_length(packet[: wire.HEADER])
    assert size == len(packet) - wire.HEADER
    found = wire.unpack(packet[wire.HEADER :], count)
    assert [(m.type, m.key, m.value, m.time, m.source) for m in found] == [
        (m.type, m.key, m.value, m.time, m.source) for m in sent
    ]


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.binary(max_size=120), st.integers(1, 3))
def test_malformed_body_raises_a_wire_error_and_nothing_else(body, count):
    try:
        wire.unpack(body, count)
    except wire.MoosWireError:
        return
    assert len(body) >= 10 * count


@pytest.mark.parametrize(
    "header",
    [b"\xff\xff\xff\x7f\x00\x00\x00\x00\x00", b"\x00" * 9, b"\x10\x00\x00\x00\x01\x00\x00\x00\x01"],
)
def test_invalid_header_is_refused(header):
    with pytest.raises(wire.MoosWireError):
        wire.body_length(header)
