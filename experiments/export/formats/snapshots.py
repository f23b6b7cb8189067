"""The photos that were taken, as JPEG."""

from collections.abc import Iterator

from django.utils.translation import gettext_lazy as _

from experiments.analysis.dataset.records import SessionRecord
from experiments.dataset.selection import Selection
from experiments.export.format import ExportFormat, File
from experiments.models import Drive
from sessions.models import Snapshot


class SnapshotsFormat(ExportFormat):
    """A file a photo; an identified export has them too."""

    label = _("with the photos")
    help = "with the photos that were taken"
    least = "researcher"

    @classmethod
    def is_in(cls, name: str, choice: Selection) -> bool:
        """Tell whether they were asked for, or everything was."""
        return choice.identified or super().is_in(name, choice)

    def of_session(self, session: SessionRecord, drive: Drive) -> Iterator[File]:
        """Yield the photos of a session in the order in which they were taken."""
        shots = (
            Snapshot.objects.filter(session=drive.session)
            .order_by("stamp")
            .values_list("jpeg", flat=True)
        )
        for number, jpeg in enumerate(shots.iterator(chunk_size=1), start=1):
            yield f"snapshots/session-{session.id}-{number}.jpg", [bytes(jpeg)]
