"""The broadcasts of this process, one for each robot that is watched through Janus."""

import functools

from django.conf import settings

from robots.bridge.bridge import Bridge
from sessions.sfu.broadcast import Broadcast
from sessions.sfu.janus import open_session
from sessions.sfu.mountpoint import mountpoint_of

_broadcasts: dict[str, Broadcast] = {}


def is_set_up() -> bool:
    """Tell whether this site has an SFU."""
    return bool(settings.JANUS_URL)


def broadcast_of(robot: str, bridge: Bridge) -> Broadcast:
    """Return the broadcast of a robot, started for its first page."""
    found = _broadcasts.get(robot)
    if found is None:
        found = _broadcasts[robot] = Broadcast(
            robot,
            mountpoint_of(settings.SECRET_KEY, robot),
            bridge,
            functools.partial(open_session, settings.JANUS_URL, settings.JANUS_SECRET),
            functools.partial(_broadcasts.pop, robot, None),
        )
    return found
