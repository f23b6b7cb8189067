"""What the apps above this one are told. Only the session manager sends them, in a thread where the
ORM may be used.

Every receiver gets `sender=Session`. What a receiver raises is logged and harms nobody else
(`send_robust`).
"""

from django.dispatch import Signal

# robot: str (its name), session: str (id), state: robots.api.messages.State, received_at: float
# (Unix seconds, server's clock), clock_offset: float | None (robot's clock minus ours, in seconds).
# Sent once for each new state of a session, in order of seq; states that were asked for again later
# are only recorded.
state_received = Signal()

# As state_received, for a state that came after a later one or a second time: asked for again
# because it was lost, or because a session manager before this one did not live to store it.
state_recovered = Signal()

# robot: str (its name; empty for a page's), session: str, message: an Event or ActionStatus of
# robots.api.messages, or a PageEvent of sessions.protocol, received_at, clock_offset as above. What
# else is heard of a session while somebody is connected to the broker, each perhaps more than once:
# what a page says comes from its own process, and a robot's session is what the robot says.
message_received = Signal()

# What is sent for what was received of sessions.
OF_SESSIONS = (state_received, state_recovered, message_received)

# now: datetime, ownership: sessions.shards.ownership.Ownership, of the process that sends it: act
# for its robots alone, and for the site if it `owns_site`. Sent twice a second, before the session
# manager looks at sessions itself.
ticked = Signal()

# robot: robots.models.Robot, reason: str, at: datetime. Its queue is paused: it could not be made
# ready for the next session.
queue_paused = Signal()

# robot: robots.models.Robot, session: sessions.models.Session, reason: str, at: datetime. The
# session is next and the robot is free, but for some seconds it has not been as the session's terms
# want it. Sent once for each session and reason.
not_ready = Signal()

# session: sessions.models.Session with its outcome. Sent at least once for each session: again,
# when the session manager died between telling and noting that it told, so receivers must not
# count.
session_ended = Signal()
