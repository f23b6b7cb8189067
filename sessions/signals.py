"""The signals for the apps above this one. Only the session manager sends them, in a thread that
may use the ORM.

Every receiver gets `sender=Session`. An exception of a receiver is logged and does not affect the
others (`send_robust`).
"""

from django.dispatch import Signal

# robot: str (its name), session: str (id), state: robots.api.messages.State, received_at: float
# (Unix seconds, server's clock), clock_offset: float | None (robot's clock minus ours, in seconds).
# Sent once for each new state of a session, in order of seq, without states that arrive late.
state_received = Signal()

# As state_received, for a state that came after a later one or a second time: it was requested
# again because it was lost, or because a previous session manager died before it stored it.
state_recovered = Signal()

# robot: str (its name; empty for a page's), session: str, message: an Event or ActionStatus of
# robots.api.messages, or a PageEvent of sessions.protocol, received_at, clock_offset as above.
# Every other message of a session, each perhaps more than once. The session is the one that the
# robot or the page's web process names.
message_received = Signal()

# The signals of received messages.
OF_SESSIONS = (state_received, state_recovered, message_received)

# now: datetime, ownership: sessions.shards.ownership.Ownership of the sending process: act only for
# its robots, and for the site if it `owns_site`. Sent twice a second, before the session manager's
# own work on sessions.
ticked = Signal()

# robot: robots.models.Robot, reason: str, at: datetime. The robot could not be made ready for the
# next session, and its queue is paused.
queue_paused = Signal()

# robot: robots.models.Robot, session: sessions.models.Session, reason: str, at: datetime. The
# session is next and the robot is free, but has not met the session's terms for some seconds. Sent
# once for each session and reason.
not_ready = Signal()

# session: sessions.models.Session with its outcome. Sent at least once for each session: again if
# the session manager died before it stored that it was sent, so receivers must not count.
session_ended = Signal()
