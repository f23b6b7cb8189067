"""`python -m tests.support.architectures.acme_drive DIRECTORY`: the agent's control loop and media
side with the installed adapter of the example package; prints what happened as JSON.
"""

import io
import json
import sys
import time
from pathlib import Path

import av
import numpy as np

from robots.agent.adapters import registry
from robots.agent.media import MediaSide
from robots.api import adapter_names, messages as m
from tests.support.agents.control_rig import ThreadedControlRig
from tests.support.host_jitter import watched

ADDRESS = "acme-in-a-test"


class Drive(ThreadedControlRig):
    """A driver, and the media side with the adapter's camera."""

    def __init__(self, directory, adapter):
        super().__init__(directory, robot=adapter)
        self.renewals = 0
        self.media = MediaSide(
            video=adapter.video(),
            audio=None,
            viewers=1,
            on_command=self.control.receive,
            reply=self.control.reply,
            on_picture=self.control.publish_picture,
            outputs=(None, None),
            trust=None,
        )

    def start(self):
        self.media.start()
        super().start()

    def go(self, speed, until):
        """Renew the lease, press and hold until the condition is true."""
        self.renewals += 1
        self.lease(renewal=self.renewals, ttl=60.0)
        self.drive(0.0, until=lambda: not self.kernel.held)
        for _ in range(600):
            if until():
                return
            self.push(speed)
            self.sleep(0.05)
        raise AssertionError(f"never so: {self.kernel.refused} {self.link.all('state')[-1]}")

    def close(self):
        super().close()
        self.media.close()


def mean_colour(jpeg):
    with av.open(io.BytesIO(jpeg)) as file:
        image = next(file.decode(video=0)).to_ndarray(format="rgb24")
    return [round(float(value)) for value in image.reshape(-1, 3).mean(axis=0)]


def main(directory):
    from telepresence_acme import acme_sdk

    device = acme_sdk.devices[ADDRESS] = acme_sdk.Device(wall=1.2)
    found = {"adapters": adapter_names.known_names()}
    adapter = registry.create("acme", "acme", {"address": ADDRESS, "timeout": "1.0"})
    rig = Drive(directory, adapter)
    rig.start()
    try:
        rig.wait(lambda: rig.link.connected and rig.kernel.fault is None, 20.0)
        rig.grant(ttl=60.0)
        rig.go(0.3, until=lambda: device.status().x > 0.15)
        found["driven"] = device.status().x
        rig.act(m.Photo(action_id="p", stamp=time.time(), session="s1", epoch=1))
        rig.status("p", "FINISHED", within=20.0)
        found["photo"] = mean_colour(rig.link.wait("photo/p"))
        rig.go(0.3, until=lambda: rig.link.all("state")[-1].safety.touched)
        found["touched"] = list(rig.link.all("state")[-1].safety.touched)
        rig.wait(lambda: device.status().linear == 0.0)
        for _ in range(10):
            rig.push(0.3)
            rig.sleep(0.05)
        found["after_contact"] = device.status().linear
        found |= hang(rig, device)
    finally:
        began = time.monotonic()
        rig.close()
        found["seconds_to_end"] = time.monotonic() - began
    print(json.dumps(found))


def hang(rig, device):
    """Let every call hang while the robot drives backwards, and measure the control loop's delay
    until the adapter is back.
    """
    rig.go(-0.2, until=lambda: device.status().linear < -0.15)
    ticks = []

    def tick():
        ticks.append(time.monotonic())
        rig.control._calls.loop.call_later(0.02, tick)

    with watched() as jitter:
        rig.post(tick)
        since, begun = len(rig.link.sent), time.time()
        device.freeze(on=True)
        lost = rig.link.wait(
            "state",
            lambda s: any(text.startswith("adapter_lost: ") for text in s.errors),
            since=since,
            within=10.0,
        )
        rig.sleep(1.0)
        late = jitter.excuse(begun, time.time())
    device.freeze(on=False)
    rig.link.wait("event", lambda event: event.type == "adapter_back", within=20.0)
    return {
        "latest_tick": float(np.diff(ticks).max()),
        "host_late": late,
        "lost": next(text for text in lost.errors if text.startswith("adapter_lost")),
    }


if __name__ == "__main__":
    main(Path(sys.argv[1]))
