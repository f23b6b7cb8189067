"""A control loop with a scripted robot, a broker in memory and a media double."""

import random

import msgspec
import numpy as np

from robots.agent.control.loop import ControlLoop
from robots.agent.lab.in_force import CLEAN
from robots.agent.media.webrtc.packet_gate import decoded
from robots.agent.robot_interface import Frame
from robots.agent.store import Store
from robots.api import messages as m
from robots.api.codec import encode_frame
from tests.support import words
from tests.support.agents.scripted_robot import ScriptedRobot
from tests.support.patience import patient
from tests.support.sessions.memory_broker import MemoryLink
from tests.support.virtual_time import RealTime, VirtualTime

QUICK = 0.05  # s; half of it is what a clock may be wrong by


class ListeningMedia:
    """A media side (publisher.Media) that records its calls."""

    ended = False

    def __init__(self):
        self.signals, self.drivers, self.told, self.wanted, self.pointed = [], [], [], [], []
        self.picture = Frame(
            np.random.default_rng(1).integers(0, 255, (48, 64, 3), dtype=np.uint8), 123.0
        )
        self.connected, self.screens, self.passing, self.network = 0, 0, [], None
        self.camera_status, self.errors = None, ()
        self.audible, self.rings = False, 0

    def start(self):
        pass

    def close(self):
        pass

    def signal(self, peer, message):
        self.signals.append((peer, message))

    def lease_changed(self, driver_peer):
        self.drivers.append(driver_peer)

    def let_through(self, **what):
        self.passing.append(what)

    def confirm(self, call):
        return call

    def ring(self):
        self.rings += 1

    def impair(self, lab):
        self.network = None if lab is None else m.LabReport(lab=lab)

    def telemetry(self, suffix, message):
        self.told.append((suffix, message))

    def point(self, pointer):
        self.pointed.append(pointer)

    def picture_wanted(self, request):
        self.wanted.append(request)

    def snapshot(self):
        return self.picture


class ControlRig:
    """A context manager with virtual time, which passes only while the test waits. It begins when
    the robot is connected, or at once.
    """

    def __init__(
        self, directory, *, robot=None, boot="boot-1", media=None, networks=CLEAN, at_once=False
    ):
        self.time, self.at_once = self.clock(), at_once
        self.robot = robot or ScriptedRobot()
        if isinstance(self.robot, ScriptedRobot):
            self.robot.times = self.time.times
        self.link, self.store = MemoryLink(self.time), Store(directory)
        self.media = media or ListeningMedia()
        capabilities = frozenset((*self.robot.profile.capabilities, "photo", "say", "call"))
        self.control = ControlLoop(
            adapter=self.robot,
            capabilities=capabilities,
            link=self.link,
            store=self.store,
            boot=boot,
            rng=random.Random(1),
            times=self.time.times,
            networks=networks,
        )
        self.seq = 0
        self._beats = 0

    clock = VirtualTime

    def __enter__(self):
        self.start()
        if not self.at_once:
            self.wait(lambda: self.link.connected and self.control.kernel.fault is None)
        return self

    def __exit__(self, *_):
        self.close()
        self.time.close()

    def start(self):
        self._running = self.time.loop.create_task(self.control.run(self.media))

    def close(self):
        self.control.close()
        self.time.run(self._running)

    @property
    def kernel(self):
        return self.control.kernel

    def now(self):
        return self.time.now()

    def unix(self):
        return self.time.unix()

    def sleep(self, seconds):
        self.time.sleep(seconds)

    def wait(self, condition, within=5.0, what="what was waited for"):
        self.time.wait(condition, within, what)

    def post(self, call, *arguments):
        """Call something in the control loop."""
        self.time.loop.call_soon_threadsafe(call, *arguments)

    def state(self):
        """Return the next state."""
        return self.link.wait("state", since=self.link.count)

    def event(self, kind):
        return self.link.wait("event", lambda event: event.type == kind)

    def lease(self, *, retained=False, **fields):
        lease = words.lease(**{"video": "none", "stamp": self.unix(), **fields})
        self.link.say("lease", lease, retained=retained)

    def grant(self, **fields):
        """Give a driver the lease, and wait until the robot knows its clock and can be driven."""
        self.lease(**fields)
        self.wait(lambda: self.kernel.leases.live(self.now()) is not None)
        self.know_clock(fields.get("peer", "p1"))
        lease = self.kernel.leases.live(self.now())
        self.push(0.0, peer=lease.peer, epoch=lease.epoch, session=lease.session)
        self.wait(lambda: not self.kernel.held)

    def know_clock(self, peer="p1", within=5.0):
        """Echo the robot's heartbeats until it knows a clock well: an echo that a busy machine
        delays makes every command look old.
        """
        begun = self.now()
        while True:
            beat = self.link.wait("heartbeat", since=self.link.count)
            for _ in range(3):
                self.beat(peer, of=beat)
                self.sleep(0.005)
            # A busy loop takes only the newest heartbeat, and a clock needs three.
            clock = self.kernel.clocks.of(peer)
            if clock is not None and min(list(clock.samples))[0] < QUICK:
                return
            assert self.now() < begun + patient(within), "every echo is late"

    def beat(self, peer="p1", way="datachannel", of=None):
        beat = of or self.link.wait("heartbeat")
        self._beats += 1
        now = self.unix()
        answer = m.CommandHeartbeat(
            n=self._beats,
            stamp=now,
            peer=peer,
            echo=m.Echo(peer="robot", n=beat.n, stamp=beat.stamp, received=now),
        )
        if way == "mqtt":
            self.link.say("command/heartbeat", answer)
        else:
            self.frame("command/heartbeat", answer, peer=peer)

    def beat_for(self, seconds):
        """Let time pass with the driver's heartbeats."""
        until = self.now() + seconds
        while self.now() < until:
            self.beat()
            self.sleep(0.2)

    def frame(self, suffix, message, *, peer="p1", role="driver"):
        self.control.receive(peer, role, decoded(encode_frame(suffix, message)))

    def command(self, linear=0.5, angular=0.0, **fields):
        self.seq += 1
        values = {"session": "s1", "epoch": 1, "seq": self.seq, "stamp": self.unix()} | fields
        return words.velocity(linear=linear, angular=angular, **values)

    def push(self, linear=0.5, *, peer="p1", role="driver", way="datachannel", **fields):
        command = self.command(linear, **fields)
        if way == "mqtt":
            self.link.say("command/velocity", command)
        else:
            self.frame("command/velocity", command, peer=peer, role=role)
        return command

    def drive(self, linear=0.5, *, until=None, way="datachannel", within=5.0, every=0.05, **fields):
        """Push at 20 Hz until the condition holds, by default until the base receives `linear`."""
        until = until or (lambda: abs(self.robot.told.linear - linear) < 1e-6)
        begun = self.now()
        while not until():
            assert self.now() < begun + patient(within), (
                f"never so: {getattr(self.robot, 'velocities', list)()[-3:]} {self.kernel.refused}"
            )
            self.push(linear, way=way, **fields)
            self.sleep(every)

    def release(self, **fields):
        """Push zeros until no stop holds the robot."""
        self.drive(0.0, until=lambda: not self.kernel.held, **fields)

    def act(self, action, *, way="mqtt", peer="p1"):
        """Ask for an action, now unless it has a stamp."""
        action = action if action.stamp else msgspec.structs.replace(action, stamp=self.unix())
        if way == "mqtt":
            self.link.say("command/action", action)
        else:
            self.frame("command/action", action, peer=peer)

    def status(self, action_id, status, within=5.0):
        return self.link.wait(
            "action", lambda a: a.action_id == action_id and a.status == status, within=within
        )

    def beat_until_end(self, action_id, within=60.0):
        """Send heartbeats until an action has ended, and return its end, which must be FINISHED."""
        ended = lambda: [
            each
            for each in self.link.all("action")
            if each.action_id == action_id and each.status in {"FINISHED", "FAILED"}
        ]
        begun = self.now()
        while not (found := ended()):
            assert self.now() < begun + patient(within), self.link.all("action")[-3:]
            self.beat()
            self.sleep(0.2)
        assert found[0].status == "FINISHED", found
        return found[0]


class ThreadedControlRig(ControlRig):
    """The control loop in its own thread and real time, as an agent runs it."""

    clock = RealTime

    def start(self):
        self.control.start(self.media)

    def close(self):
        self.control.close()

    def post(self, call, *arguments):
        self.control._calls.loop.call_soon_threadsafe(call, *arguments)


def stamped(kind, action_id="a1", **fields):
    return kind(action_id=action_id, stamp=0.0, **fields)  # the rig stamps it


def staff(kind, action_id="a1", **fields):
    return stamped(kind, action_id, role="staff", user="ops", **fields)


def own(kind, action_id="a1", **fields):
    return stamped(kind, action_id, session="s1", epoch=1, **fields)
