"""Sends what was received of sessions to the apps above, in the scheduler's thread."""

import uuid
from collections.abc import Iterable, Mapping

import structlog

from robots.api.errors import Rejection
from sessions import protocol, signals
from sessions.manager.ingest import Fresh
from sessions.manager.scheduler import send
from sessions.models import Session
from sessions.recording.items import ActionItem, EventItem, PageItem, StateItem
from sessions.shards.ownership import EVERYTHING, Ownership

logger = structlog.stdlib.get_logger(__name__)


def send_all(
    items: Iterable[Fresh], offsets: Mapping[str, float | None], ownership: Ownership = EVERYTHING
) -> None:
    """Send the signals of our robots' items; `offsets` in seconds, as state_received has it."""
    for item in items:
        if ownership.is_whole and isinstance(item, PageItem):
            _send_item(item, offsets)
        elif (robot := _robot_of(item)) is not None and ownership.owns(robot):
            with ownership.about(robot):
                _send_item(item, offsets)


def _robot_of(item: Fresh) -> str | None:
    """Return the name of the robot that an item is about; None for an unknown session."""
    if not isinstance(item, PageItem):
        return item.robot
    if item.report.suffix != "page/event":
        return None
    try:
        session = Session.objects.filter(pk=uuid.UUID(item.report.session))
    except ValueError:
        return None
    name: str | None = session.values_list("robot__name", flat=True).first()
    return name


def _send_item(item: Fresh, offsets: Mapping[str, float | None]) -> None:
    match item:
        case StateItem():
            send(
                signals.state_recovered if item.late else signals.state_received,
                robot=item.robot,
                session=item.state.session,
                state=item.state,
                received_at=item.received_at,
                clock_offset=item.clock_offset,
            )
        case EventItem(robot, event, received_at) if event.session is not None:
            _send(robot, event.session, event, received_at, offsets.get(robot))
        case ActionItem(robot, session, status, received_at):
            _send(robot, session, status, received_at, offsets.get(robot))
        case PageItem() if item.report.suffix == "page/event":
            _send_page(item)


def _send(
    robot: str, session: str, message: object, received_at: float, offset: float | None
) -> None:
    send(
        signals.message_received,
        robot=robot,
        session=session,
        message=message,
        received_at=received_at,
        clock_offset=offset,
    )


def _send_page(item: PageItem) -> None:
    report = item.report
    try:
        message = protocol.decode(report.suffix, bytes(report.message).decode())
    except (Rejection, UnicodeDecodeError) as error:
        logger.warning("page_report_malformed", session=report.session, reason=str(error))
        return
    _send("", report.session, message, item.received_at, None)
