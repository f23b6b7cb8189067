"""The faults of the server, as one web process sees them: pure, `now` is monotonic seconds.

A stopped process keeps its connections, so that its silence shows the fault, and not a closed
socket. The session manager publishes its status twice a second. When it is silent, the broker is
asked for one acknowledgement: with it, the session manager is at fault, without it the broker.
"""

from robots.api.messages import ManagerStatus
from robots.bridge.known import KnownRobot

BROKER, SESSION_MANAGER, ROBOT = "broker", "session_manager", "robot"
# of the session manager's silence before a probe of the broker, and between two probes
PROBE_SECONDS = 0.7
MANAGER_SECONDS = 1.4  # of silence until it is a fault; it publishes every 0.5 s
BROKER_SECONDS = 0.7  # for which the broker may owe an acknowledgement
ROBOT_SECONDS = 1.2  # of silence until it is a fault; it sends five heartbeats a second


class ServerWatch:
    """The last messages of the session manager, and probes of the broker."""

    def __init__(self) -> None:
        self._linked = False
        self._status: ManagerStatus | None = None
        self._last_received_at = float("-inf")
        self._asked_at: float | None = None  # the first probe without an answer
        self._asked_last = float("-inf")
        self._has_answered = False  # since the session manager's last status

    def link_changed(self, now: float, *, up: bool) -> None:
        """Note that the broker was connected or lost. A session manager that lost it, too, has
        MANAGER_SECONDS to reconnect.
        """
        self._linked, self._last_received_at, self._status = up, now, None
        self._asked_at, self._asked_last, self._has_answered = None, float("-inf"), False

    def on_status(self, status: ManagerStatus, now: float) -> None:
        """Note the session manager's status, which also shows that the broker works."""
        self._status, self._last_received_at = status, now
        self._asked_at, self._has_answered = None, False

    def wants_probe(self, now: float) -> bool:
        """Tell whether a probe is due now; the caller sends it, and calls `answered`."""
        if not self._linked or now - max(self._last_received_at, self._asked_last) < PROBE_SECONDS:
            return False
        self._asked_last = now
        self._asked_at = now if self._asked_at is None else self._asked_at
        return True

    def answered(self) -> None:
        self._asked_at, self._has_answered = None, True

    def faults(self, robot: KnownRobot, now: float) -> tuple[str, ...]:
        """Return the present faults, for the pages of one robot."""
        if not self._linked or (
            self._asked_at is not None and now - self._asked_at >= BROKER_SECONDS
        ):
            return (BROKER,)
        if self._asked_at is not None and not self._has_answered:
            # The broker may be at fault, so that the silence of others means nothing.
            return ()
        silent = (ROBOT,) if robot.is_silent(now, ROBOT_SECONDS) else ()
        if now - self._last_received_at >= MANAGER_SECONDS:
            return (SESSION_MANAGER, *silent)
        return (*(self._status.faults if self._status is not None else ()), *silent)
