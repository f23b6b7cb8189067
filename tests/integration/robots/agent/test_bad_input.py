"""Bad input on a real data channel is refused and counted, and stops always pass."""

import asyncio
import json
import random
import time
from collections import Counter

import pytest

from robots.agent.ramp import ZERO
from robots.api import messages as m
from robots.api.codec import encode_frame
from tests.support.agents.control_rig import ThreadedControlRig
from tests.support.media.loopback_peer import MediaRig, until
from tests.support.media.synthetic_camera import SyntheticCamera, SyntheticMicrophone

CASES = 420
PACE = 1 / 100  # s, slower than a flood, so that each case reaches the codec and the kernel
A_STOP_EVERY = 20


@pytest.fixture
async def pages():
    """The media side of `pages.agent`, and its pages."""
    receive = lambda peer, role, heard: pages.agent.control.receive(peer, role, heard)
    sources = {"video": SyntheticCamera(), "audio": SyntheticMicrophone()}
    async with MediaRig(**sources, on_command=receive) as pages:
        yield pages


@pytest.fixture
async def rig(tmp_path, pages):
    rig = pages.agent = ThreadedControlRig(tmp_path, media=pages.media)
    await asyncio.to_thread(rig.__enter__)
    yield rig
    await asyncio.to_thread(rig.__exit__)


def velocity(rig, **fields):
    """Return a driver's command as text, with values that no message could have."""
    rig.seq += 1
    good = {"session": "s1", "epoch": 1, "seq": rig.seq, "stamp": time.time()}
    good |= {"linear": 0.5, "angular": 0.1, "method": "keyboard"}
    return "command/velocity\n" + json.dumps(good | fields)


def mangled(rig, noise):
    text = list(velocity(rig))
    for _ in range(noise.randrange(1, 6)):
        text[noise.randrange(17, len(text))] = noise.choice('{}[]",:x\\\x00é')
    broken = "".join(text)
    try:
        json.loads(broken.partition("\n")[2])
    except ValueError:
        return broken
    return broken[: len(broken) // 2]


# fields of a velocity, and values that must not move the robot; names begin with the counted reason
FIELDS = {
    "malformed range": ("linear", (1e3, -1e9, 10.1, 1e300)),
    "malformed turn": ("angular", (99.0, -20.5)),
    "malformed NaN": ("linear", (float("nan"), float("inf"), float("-inf"))),
    "malformed type": ("seq", ("1", None, 1.5, -1, 2**60)),
    "malformed method": ("method", ("thought", "", 7, None)),
    "wrong_session": ("session", ("s2", "s98")),
    "wrong_epoch": ("epoch", (0, 2, 3, 2**40)),
    "old_seq": ("seq", (0, 1)),
}
# each makes another frame that must not
KINDS = {
    "malformed noise": lambda rig, noise: noise.randbytes(noise.randrange(1, 300)),
    "malformed json": mangled,
    "malformed action": lambda rig, noise: (
        "command/action\n"
        + json.dumps({"type": noise.choice(("fly", "", "goto", None)), "actionId": "§"})
    ),
    "oversized": lambda rig, noise: "command/velocity\n" + " " * noise.randrange(5_000, 40_000),
    "stale": lambda rig, noise: velocity(rig, stamp=time.time() - noise.uniform(1.5, 1e5)),
    "future": lambda rig, noise: velocity(rig, stamp=time.time() + noise.uniform(0.5, 1e5)),
    "not_from_server": lambda rig, noise: encode_frame(
        noise.choice(("lease", "config", "signal/p1", "floorplan")), m.Bye(reason="x")
    ),
} | {
    name: lambda rig, noise, field=field, values=values: velocity(
        rig, **{field: noise.choice(values)}
    )
    for name, (field, values) in FIELDS.items()
}


async def test_bad_messages_on_a_data_channel_move_nothing_and_stops_always_pass(rig, pages):
    await asyncio.to_thread(rig.lease)
    driver, observer = pages.page("p1", decode=False), pages.page("p2", decode=False)
    await driver.connect("driver")
    await observer.connect("observer")
    await asyncio.to_thread(rig.grant, renewal=1)
    await send_bad_messages(rig, driver, observer)


async def send_bad_messages(rig, driver, observer):
    noise, began = random.Random(11), time.monotonic()
    kinds = list(KINDS)
    for number in range(CASES):
        await asyncio.sleep(PACE)
        name = kinds[number % len(kinds)]
        driver.channel.send(KINDS[name](rig, noise))
        observer.channel.send(velocity(rig))
        if number % 40 == 0:
            await asyncio.to_thread(rig.lease, renewal=2 + number)
        if number % A_STOP_EVERY == 0:
            await stop_passes(rig, (driver, observer)[number // A_STOP_EVERY % 2], f"stop-{number}")
    enough = lambda: counted(rig).total() >= 2 * CASES * 0.99
    await until(enough, 10, f"all refusals: {counted(rig)}")
    assert all(speed == ZERO for _, speed in rig.robot.velocities(began)), "the robot moved"
    assert set(counted(rig)) >= {name.split()[0] for name in KINDS} | {"observer"}


async def stop_passes(rig, page, action_id):
    page.channel.send(encode_frame("command/action", m.Stop(action_id=action_id, stamp=0.0)))
    # The channel is unreliable, but loses nothing on loopback.
    echoed = lambda: any(s.safety.stop_id == action_id for s in rig.link.all("state"))
    await until(echoed, 5, f"the echo of {action_id}")


def counted(rig):
    """Return how often each reason was counted."""
    total = Counter()
    for state in rig.link.all("state"):
        total.update(state.refused)
    return total
