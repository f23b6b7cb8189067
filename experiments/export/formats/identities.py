"""The table of an identified export that leads from codes to people, a line a session."""

from collections.abc import Iterator, Sequence
from typing import Any

from experiments.dataset.columns import Column
from experiments.dataset.records import SessionRecord
from experiments.export.format import ExportFormat, File
from experiments.extraction.selection import Selection
from experiments.models import Drive

IDENTITIES = (
    Column("participant", "", "code of the participant"),
    Column("session", "", "code of the session"),
    Column("user", "", "key of the user's row"),
    Column("username", "", "name of the user"),
    Column("email", "", "address of the user"),
    Column("session_key", "", "key of the session's row"),
    Column("granted", "", "when the robot was granted"),
    Column("address", "", "address of the visitor's network, truncated"),
    Column("user_agent", "", "the browser's user agent"),
    Column("recruitment", "", "parameters of the link by which the participant came"),
)


class IdentitiesFormat(ExportFormat):
    tables = {"identities": IDENTITIES}

    @classmethod
    def is_in(cls, _name: str, choice: Selection) -> bool:
        return choice.identified

    def of_study(self) -> Iterator[File]:
        rows = map(_identity, self.source.dataset.sessions, self.source.drives)
        yield self.source.table("identities", rows)


def _identity(session: SessionRecord, drive: Drive) -> Sequence[Any]:
    user, visit, device = drive.participant.user, drive.session, drive.session.device or {}
    parameters = sorted(drive.participant.recruitment.items())
    recruitment = "&".join(f"{name}={value}" for name, value in parameters)
    who = ("", "", "") if user is None else (str(user.pk), user.username, user.email)
    about = (device.get("network", ""), device.get("user_agent", ""), recruitment)
    granted = drive.granted_at.isoformat()
    return drive.participant.code, session.id, *who, str(visit.pk), granted, *about
