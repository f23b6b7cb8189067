"""The chat between a visitor who waits for a stopped robot and the people beside it.

Otherwise the robot carries the driver's chat, but a robot with an active emergency stop is given to
no driver. The web processes carry this chat through the channel layer; it is not recorded. Only the
first in the queue takes part, who can drive as soon as the stop is released, and no participant of
a study, whose terms decide what a participant may do.
"""

import datetime
import time

from robots.api.codec import encode_frame
from robots.api.messages import Say, Words
from robots.bridge.known import KnownRobot
from sessions import page_channel
from sessions.leases import terms
from sessions.leases.store import waits_here
from sessions.models import Session


def is_open(known: KnownRobot, now: float) -> bool:
    """Tell whether a robot is stopped and has no driver; `now` is monotonic seconds."""
    stopped = known.state is not None and known.state.safety.estop
    return stopped and known.lease_at(now) is None


def first_waiting(robot: str, now: datetime.datetime) -> tuple[str, str] | None:
    """Return session and name of the first in a robot's queue whose page is open; None without one,
    or for a participant of a study.
    """
    row = (
        Session.objects.filter(waits_here(now), robot__name=robot)
        .select_related("visitor", "robot")
        .defer("device", "summary")
        .order_by("queued_at")
        .first()
    )
    if row is None or terms.claims(row.visitor, row.robot):
        return None
    return str(row.pk), row.visitor.sent_name


async def write(robot: str, session: str, action: Say, *, by: str, who: str) -> None:
    """Send a message to the page of the session and to the robot's displays."""
    words = Words(
        stamp=time.time(),
        action_id=action.action_id,
        session=session,
        by=by,  # type: ignore[arg-type]
        who=who,
        text=action.text,
        language=action.language,
    )
    await page_channel.send_words(robot, session, encode_frame("words", words))
