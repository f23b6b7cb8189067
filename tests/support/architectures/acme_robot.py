"""The example of an adapter in a package of its own, with the simulated robot of the other
adapters' tests behind its SDK.
"""

import sys

from tests.support.architectures.rca_world import RcaRig
from tests.support.paths import ROOT

EXAMPLE = ROOT / "docs" / "examples" / "acme_robot"


def acme_sdk():
    return sys.modules["telepresence_acme.acme_sdk"]


class AcmeRig(RcaRig):
    """The SDK's calls reach the simulated robot of this rig."""

    series = "rhodon"
    address = "acme-in-a-test"

    def __init__(self):
        super().__init__()
        self.device = None

    def adapter(self, **options):
        from robots.agent.adapters import registry

        return registry.create(
            "telepresence_acme.adapter",
            "acme",
            {"address": self.address, "timeout": "0.5", **options},
        )

    async def up(self):
        import telepresence_acme.adapter

        sdk, rig = telepresence_acme.adapter.acme_sdk, self

        class Simulated(sdk.Device):
            def drive(self, linear, angular):
                rig.loop.call_soon_threadsafe(rig.world.drive, linear, angular)

            def status(self):
                sim = rig.world.sim
                return sdk.Status(
                    *sim.odometry,
                    sim.motion.linear,
                    sim.motion.angular,
                    volts=sim.voltage(),
                    bumper=False,
                )

        self.device = sdk.devices[self.address] = Simulated()

    async def down(self):
        self.device.is_disconnected = True

    def freeze(self, *, on):
        self.device.freeze(on=on)
