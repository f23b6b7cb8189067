"""A condition as it is set on a robot, and whether it was in force.

What was assigned and what the robot said of itself are both kept; `mismatches` tells where they
differ, and a session with any is flagged.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import msgspec

from experiments.definition.feasibility import CAPABILITY
from experiments.definition.schema import Condition, Impairment
from robots.api.floorplan import DoorState
from robots.api.messages import Config, LabReport, LeaseLimits, NetworkLab, State

FASTER = 1.02  # a robot may overshoot its limit by so much
# nobody is kept from these
ALWAYS = frozenset(
    {"stop", "estop", "cancel", "photo", "say", "call", "knock", "relocalize", "resend_states"}
)


def allowed_actions(condition: Condition) -> frozenset[str]:
    """Return the types of Robot API actions that a visitor may ask for under a condition; they are
    called like the capabilities.
    """
    return ALWAYS | {CAPABILITY[action] for action in condition.actions}


def without_driving(condition: Condition) -> Condition:
    """Return what a participant may do in a condition in which a hidden operator drives."""
    return msgspec.structs.replace(condition, controllers=(), actions=(), idle_seconds=None)


def lease_limits(condition: Condition) -> LeaseLimits:
    """Return the speeds that a lease allows under a condition; the robot's own limits hold below
    them.
    """
    return LeaseLimits(linear=condition.speed.linear, angular=condition.speed.angular)


def config(condition: Condition, doors: Iterable[str], *, stamp: float, seed: int) -> Config:
    """Return what the server sets on the robot for a condition.

    Args:
        condition: the one that was assigned.
        doors: the names of all doors of the site: those not closed are opened.
        stamp: Unix time in seconds.
        seed: of the session, for its network's chance.
    """
    states: dict[str, DoorState] = {
        name: "closed" if name in condition.doors_closed else "open" for name in doors
    }
    control, video = condition.network.control, condition.network.video
    return Config(
        stamp=stamp,
        assist=condition.assist,
        doors=states,
        control_network=_lab(control, seed),
        video_network=_lab(video, seed + 1),
    )


def _lab(impairment: Impairment | None, seed: int) -> NetworkLab | None:
    if _effective(impairment) is None or impairment is None:
        return None
    return NetworkLab(
        delay=impairment.delay,
        jitter=impairment.jitter,
        loss=impairment.loss,
        reorder=impairment.reorder,
        bitrate=impairment.bitrate,
        seed=seed,
    )


@dataclass
class Applied:
    """What was in force in a session, gathered from what the robot and the server's record say.
    Speeds are the greatest, in m/s and rad/s.

    `impaired` is every pair of networks that the robot reported while it was driven,
    `control_network` and `video_network` its last word on what had become of their packets.
    """

    robot: str
    site: str
    interface: str = ""
    assist: set[str] = field(default_factory=set)
    methods: set[str] = field(default_factory=set)
    ways: set[str] = field(default_factory=set)
    actions: set[str] = field(default_factory=set)
    doors_closed: set[str] = field(default_factory=set)
    impaired: set[tuple[Impairment | None, Impairment | None]] = field(default_factory=set)
    control_network: LabReport | None = None
    video_network: LabReport | None = None
    linear: float = 0.0
    angular: float = 0.0

    def see(self, state: State) -> None:
        """Take in a state of the session."""
        self.assist.add(state.assist)
        self.linear = max(self.linear, *(abs(command.linear) for command in state.applied), 0.0)
        self.angular = max(self.angular, *(abs(command.angular) for command in state.applied), 0.0)
        self.methods |= {command.method for command in state.applied}
        self.ways |= {command.way for command in state.applied}
        # in between, and while a visitor is away, the robot has no driver whose network it could be
        if state.applied:
            self.impaired.add(
                (_impairment(state.control_network), _impairment(state.video_network))
            )
        self.control_network = state.control_network or self.control_network
        self.video_network = state.video_network or self.video_network


# What of a condition is compared with what was in force, in the order of its fields.
ASPECTS = (
    "robot",
    "site",
    "control_way",
    "controllers",
    "actions",
    "assist",
    "interface",
    "speed",
    "doors_closed",
    "network",
)
# What is a participant's to do, and in force for nobody while a hidden operator drives.
OF_THE_DRIVER = frozenset({"control_way", "controllers", "actions"})


def mismatches(
    condition: Condition, applied: Applied, *, by_wizard: bool = False
) -> tuple[str, ...]:
    """Return the names of what was not as the condition says, in the order of its fields; empty
    when all was. `by_wizard` is whether a hidden operator drove.
    """
    network = condition.network
    speed = condition.speed
    wrong = {
        "robot": applied.robot != condition.robot,
        "site": applied.site != condition.site,
        "control_way": condition.control_way != "any"
        and bool(applied.ways - {condition.control_way}),
        "controllers": bool(applied.methods - set(condition.controllers)),
        "actions": bool(applied.actions - allowed_actions(condition)),
        "assist": bool(applied.assist - {condition.assist}),
        "interface": applied.interface not in {"", condition.interface},
        "speed": _faster(applied.linear, speed.linear) or _faster(applied.angular, speed.angular),
        "doors_closed": applied.doors_closed != set(condition.doors_closed),
        "network": bool(
            applied.impaired - {(_effective(network.control), _effective(network.video))}
        ),
    }
    skipped = OF_THE_DRIVER if by_wizard else frozenset()
    return tuple(name for name in ASPECTS if wrong[name] and name not in skipped)


def _impairment(report: LabReport | None) -> Impairment | None:
    """Return what a robot says that it has put on one direction, as a condition would say it."""
    if report is None:
        return None
    lab = report.lab
    return _effective(
        Impairment(
            delay=lab.delay,
            jitter=lab.jitter,
            loss=lab.loss,
            reorder=lab.reorder,
            bitrate=lab.bitrate,
        )
    )


def _effective(impairment: Impairment | None) -> Impairment | None:
    """One that changes nothing is none."""
    return None if impairment == Impairment() else impairment


def _faster(measured: float, limit: float | None) -> bool:
    return limit is not None and measured > limit * FASTER
