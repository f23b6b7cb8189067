"""Which emulated network a driver gets, and which messages it carries. Pure.

A study's networks belong to one session: the next driver has none, even before the server sends
that. The command line's networks apply where the server sets none. Without a driver there are none.
"""

from dataclasses import dataclass

from robots.agent.safety.permissions import CommandSender, mismatch, role_of
from robots.api.messages import (
    UNCONDITIONAL,
    Action,
    Cancel,
    Config,
    Lease,
    NetworkLab,
    RouteRequest,
    VelocityCommand,
)

# These pass at once, whatever the network is: a stop must not wait.
NEVER_HELD: tuple[type[Action], ...] = (*UNCONDITIONAL, Cancel)


@dataclass(frozen=True)
class Networks:
    """Networks for commands to the robot, and for video and sound to the page."""

    control: NetworkLab | None = None
    video: NetworkLab | None = None
    session: str | None = None


CLEAN = Networks()


def in_force(lease: Lease | None, config: Config | None, own: Networks) -> Networks:
    """Return the driver's networks: of the server's `config`, else `own`, the command line's."""
    if lease is None:
        return CLEAN
    applies = config is not None and config.network_session in {None, lease.session}
    control = config.control_network if config is not None and applies else None
    video = config.video_network if config is not None and applies else None
    found = Networks(control or own.control, video or own.video, lease.session)
    return CLEAN if found.control is None and found.video is None else found


def is_held(
    message: VelocityCommand | Action | RouteRequest, sender: CommandSender, lease: Lease | None
) -> bool:
    """Tell whether the driver's network carries a message: their velocities, actions and route
    requests, but never a stop. Messages of others are not held, and draw no random numbers.
    """
    if lease is None or sender.retained or isinstance(message, NEVER_HELD):
        return False
    if isinstance(message, Action) and role_of(message, sender, lease) != "driver":
        return False
    return mismatch(message.session, message.epoch, sender, lease) is None
