"""Which part of the server does not do its work, as one web process sees it: pure, `now` is
monotonic seconds.

A process that was stopped keeps its connections, so silence is the sign and not a closed socket.
The session manager speaks twice a second. When it is silent the broker is asked for one
acknowledgement: with it the session manager fails, without it the broker.
"""

from robots.api.messages import ManagerStatus
from robots.bridge.known import KnownRobot

BROKER, SESSION_MANAGER, ROBOT = "broker", "session_manager", "robot"
# of the session manager's silence until the broker is asked, and between two questions
PROBE_SECONDS = 0.7
MANAGER_SECONDS = 1.4  # of silence until it is a fault; it speaks every half second
BROKER_SECONDS = 0.7  # for which the broker may owe an acknowledgement
ROBOT_SECONDS = 1.2  # its heart beats five times a second


class ServerWatch:
    """What was last heard of broker and session manager."""

    def __init__(self) -> None:
        self._linked = False
        self._status: ManagerStatus | None = None
        self._last_received_at = float("-inf")
        self._asked_at: float | None = None  # the first question that was not answered
        self._asked_last = float("-inf")
        self._has_answered = False  # since the session manager was heard last

    def link_changed(self, now: float, *, up: bool) -> None:
        """Note that the broker was reached, or lost; a session manager that lost it too has the
        usual time to come back.
        """
        self._linked, self._last_received_at, self._status = up, now, None
        self._asked_at, self._asked_last, self._has_answered = None, float("-inf"), False

    def heard(self, status: ManagerStatus, now: float) -> None:
        """Note the session manager's heartbeat, which proves the broker as well."""
        self._status, self._last_received_at = status, now
        self._asked_at, self._has_answered = None, False

    def wants_probe(self, now: float) -> bool:
        """Tell whether the broker is to be asked now; the caller does so, and calls `answered`."""
        if not self._linked or now - max(self._last_received_at, self._asked_last) < PROBE_SECONDS:
            return False
        self._asked_last = now
        self._asked_at = now if self._asked_at is None else self._asked_at
        return True

    def answered(self) -> None:
        """Note the broker's acknowledgement."""
        self._asked_at, self._has_answered = None, True

    def faults(self, robot: KnownRobot, now: float) -> tuple[str, ...]:
        """Return the parts that fail now, for the pages of one robot."""
        if not self._linked or (
            self._asked_at is not None and now - self._asked_at >= BROKER_SECONDS
        ):
            return (BROKER,)
        if self._asked_at is not None and not self._has_answered:
            # through a broker that perhaps fails nobody is heard, so that silence says nothing of
            # anybody else
            return ()
        silent = (ROBOT,) if robot.is_silent(now, ROBOT_SECONDS) else ()
        if now - self._last_received_at >= MANAGER_SECONDS:
            return (SESSION_MANAGER, *silent)
        return (*(self._status.faults if self._status is not None else ()), *silent)
