"""The photos that were taken, as JPEG."""

from collections.abc import Iterator

import structlog
from django.utils.translation import gettext_lazy as _

from experiments.dataset.records import SessionRecord
from experiments.export.format import ExportFormat, File
from experiments.export.jpeg import JpegError, without_metadata
from experiments.extraction.selection import Selection
from experiments.models import Drive
from sessions.models import Snapshot

log = structlog.stdlib.get_logger(__name__)


class SnapshotsFormat(ExportFormat):
    label = _("with the photos")
    help = "with the photos that were taken"
    least = "researcher"

    @classmethod
    def is_in(cls, name: str, choice: Selection) -> bool:
        return choice.identified or super().is_in(name, choice)

    def of_session(self, session: SessionRecord, drive: Drive) -> Iterator[File]:
        rows = Snapshot.objects.filter(session=drive.session).order_by("stamp")
        shots = rows.values_list("jpeg", flat=True)
        for number, jpeg in enumerate(shots.iterator(chunk_size=1), start=1):
            name = f"session-{session.id}-{number}"
            photo = self._photo(bytes(jpeg), name)
            if photo is not None:
                yield f"snapshots/{name}.jpg", [photo]

    def _photo(self, jpeg: bytes, name: str) -> bytes | None:
        """Return a photo, without metadata unless the export is identified; None if this fails."""
        if self.source.release.choice.identified:
            return jpeg
        try:
            return without_metadata(jpeg, name)
        except JpegError as error:
            log.warning("photo_not_exported", photo=name, reason=str(error))
            return None
