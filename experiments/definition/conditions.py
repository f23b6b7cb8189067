"""A condition as it is set on a robot, and whether it was in force (`mismatches`)."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from msgspec.structs import asdict, replace

from experiments.definition.feasibility import CAPABILITY
from experiments.definition.schema import Condition, Impairment
from robots.api.floorplan import DoorState
from robots.api.messages import Config, LabReport, LeaseLimits, NetworkLab, State

FASTER = 1.02  # the overshoot of a speed limit that is no mismatch
# Actions that every condition allows.
ALWAYS = frozenset(
    {"stop", "estop", "cancel", "photo", "say", "call", "knock", "relocalize", "resend_states"}
)


def allowed_actions(condition: Condition) -> frozenset[str]:
    """Return the types of Robot API actions that a condition allows."""
    return ALWAYS | {CAPABILITY[action] for action in condition.actions}


def without_driving(condition: Condition) -> Condition:
    """Return a condition for a participant while a hidden operator drives."""
    return replace(condition, controllers=(), actions=(), idle_seconds=None)


def lease_limits(condition: Condition) -> LeaseLimits:
    return LeaseLimits(linear=condition.speed.linear, angular=condition.speed.angular)


def config(condition: Condition, doors: Iterable[str], *, stamp: float, seed: int) -> Config:
    """Return what the server sets on the robot for a condition, at `stamp` (Unix time in s).

    `doors` are all doors of the site: those that the condition does not close are opened. `seed` is
    that of the session, for the random losses and jitter of its network.
    """
    closed: frozenset[str] = frozenset(condition.doors_closed)
    states: dict[str, DoorState] = {one: "closed" if one in closed else "open" for one in doors}
    return Config(
        stamp=stamp,
        assist=condition.assist,
        doors=states,
        control_network=_lab(condition.network.control, seed),
        video_network=_lab(condition.network.video, seed + 1),
    )


def _lab(impairment: Impairment | None, seed: int) -> NetworkLab | None:
    found = _effective(impairment)
    return NetworkLab(**asdict(found), seed=seed) if found is not None else None


@dataclass
class Applied:
    """The settings in force in a session, by the states of the robot and the server's record.
    Speeds are maxima in m/s and rad/s; `impaired` has every pair of networks that the robot
    reported while it was driven, `control_network` and `video_network` its last reports.
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
        self.assist.add(state.assist)
        self.linear = max(self.linear, *(abs(command.linear) for command in state.applied), 0.0)
        self.angular = max(self.angular, *(abs(command.angular) for command in state.applied), 0.0)
        self.methods |= {command.method for command in state.applied}
        self.ways |= {command.way for command in state.applied}
        # without a driver, the networks are not those of the condition
        if state.applied:
            networks = state.control_network, state.video_network
            self.impaired.add((_impairment(networks[0]), _impairment(networks[1])))
        self.control_network = state.control_network or self.control_network
        self.video_network = state.video_network or self.video_network


# The fields of a condition that are compared with what was in force.
NOT_APPLIED = frozenset({"key", "title", "levels", "access", "idle_seconds"})
ASPECTS = tuple(name for name in Condition.__struct_fields__ if name not in NOT_APPLIED)
# Aspects that are the driver's: not in force while a hidden operator drives.
OF_THE_DRIVER = frozenset({"control_way", "controllers", "actions"})


def mismatches(
    condition: Condition, applied: Applied, *, by_wizard: bool = False
) -> tuple[str, ...]:
    """Return the fields of a condition that were not in force; `by_wizard`: an operator drove."""
    network, speed = condition.network, condition.speed
    networks = _effective(network.control), _effective(network.video)
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
        "network": bool(applied.impaired - {networks}),
    }
    skipped = OF_THE_DRIVER if by_wizard else frozenset()
    return tuple(name for name in ASPECTS if wrong[name] and name not in skipped)


def _impairment(report: LabReport | None) -> Impairment | None:
    if report is None:
        return None
    lab = asdict(report.lab)
    return _effective(Impairment(**{name: lab[name] for name in Impairment.__struct_fields__}))


def _effective(impairment: Impairment | None) -> Impairment | None:
    """Return None for an impairment that changes nothing."""
    return None if impairment == Impairment() else impairment


def _faster(measured: float, limit: float | None) -> bool:
    return limit is not None and measured > limit * FASTER
