"""What can break on a simulated robot, so that the rest of the system can be seen to notice."""

from typing import Literal

import msgspec

LaserFault = Literal["none", "silent", "nan"]


class Faults(msgspec.Struct, frozen=True, kw_only=True):
    """`wheels_stopped`: the motors do not turn; `laser`: silent, or only NaN."""

    wheels_stopped: bool = False
    laser: LaserFault = "none"


SOUND = Faults()
