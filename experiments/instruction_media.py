"""Uploaded pictures and videos of instructions, named by their content: "own-<hash>-png"."""

import datetime
import hashlib
import re
from collections.abc import Iterable
from typing import Any

from django.core.files.uploadedfile import UploadedFile
from django.db.models import Q
from django.http import HttpRequest, HttpResponse
from django.shortcuts import get_object_or_404
from django.utils.translation import gettext as _
from django.views.decorators.cache import cache_control
from django.views.decorators.http import require_safe

from experiments.definition.steps.instructions import OWN_MEDIA
from experiments.models import InstructionMedia, Study

MB = 1024 * 1024
MOST_PICTURE, MOST_VIDEO = 2 * MB, 8 * MB  # bytes
# By the end of the name: media type, and offset and bytes of the signature.
KINDS: dict[str, tuple[str, int, bytes]] = {
    "png": ("image/png", 0, b"\x89PNG\r\n\x1a\n"),
    "jpg": ("image/jpeg", 0, b"\xff\xd8\xff"),
    "gif": ("image/gif", 0, b"GIF8"),
    "webp": ("image/webp", 8, b"WEBP"),
    "mp4": ("video/mp4", 4, b"ftyp"),
    "webm": ("video/webm", 0, b"\x1a\x45\xdf\xa3"),
}
ACCEPTED = ",".join(media_type for media_type, _at, _signature in KINDS.values())
# One range of bytes: from the first to the last, or, without a first, so many at the end.
RANGE = re.compile(r"bytes=(?=.*[0-9])([0-9]{0,12})-([0-9]{0,12})\Z")
YEAR = 365 * 24 * 3600


class RefusedMediaError(ValueError):
    """A file that cannot be used in instructions; the message is for the page."""


def is_video(name: str) -> bool:
    return name.endswith(("-mp4", "-webm"))


def store(slug: str, file: UploadedFile, now: datetime.datetime) -> str:
    """Store a file for the instructions of a study, and return its name; one that is too large, or
    of an unknown type, is a RefusedMediaError.
    """
    size = file.size or 0
    head = file.read(16)
    kind = next((end for end, (_t, at, sign) in KINDS.items() if head[at:].startswith(sign)), "")
    if not kind:
        raise RefusedMediaError(_("Choose a PNG, JPEG, GIF, WebP, MP4 or WebM file."))
    most = MOST_VIDEO if is_video(f"-{kind}") else MOST_PICTURE
    if size > most:
        words = _("The file has %(size).1f MB; at most %(most)g MB are allowed.")
        raise RefusedMediaError(words % {"size": size / MB, "most": most / MB})
    content = head + file.read()
    name = f"{OWN_MEDIA}{hashlib.sha256(content).hexdigest()[:32]}-{kind}"
    row = {"slug": slug, "title": (file.name or name)[:200], "content": content, "uploaded_at": now}
    InstructionMedia.objects.get_or_create(name=name, defaults=row)
    return name


def titles(slug: str, used: Iterable[str]) -> dict[str, str]:
    """Return file names by name: of a study's own media, and of `used` media of other studies."""
    names = [name for name in used if name.startswith(OWN_MEDIA)]
    rows = InstructionMedia.objects.filter(Q(slug=slug) | Q(name__in=names))
    return dict(rows.values_list("name", "title"))


def forget(instance: Study, **_more: Any) -> None:
    """Delete the media of a study with its last version, except those that other studies show."""
    if Study.objects.filter(slug=instance.slug).exists():
        return
    shown = str(list(Study.objects.values_list("definition", flat=True)))
    own = InstructionMedia.objects.filter(slug=instance.slug)
    names = [name for name in own.values_list("name", flat=True) if name not in shown]
    own.filter(name__in=names).delete()


@require_safe
@cache_control(public=True, max_age=YEAR, immutable=True)
def media(request: HttpRequest, name: str) -> HttpResponse:
    """Show a picture or a video, or a range of its bytes (RFC 9110, 14): Safari plays no video
    without. Its name cannot be guessed, and its content never changes.
    """
    row: Any = get_object_or_404(InstructionMedia, name=name)
    content, kind = bytes(row.content), KINDS[name.rpartition("-")[2]][0]
    asked, size = RANGE.match(request.headers.get("Range", "")), len(content)
    if asked is None:
        return HttpResponse(content, content_type=kind, headers={"Accept-Ranges": "bytes"})
    begin, end = asked.groups()
    first = int(begin) if begin else max(0, size - int(end))
    last = min(int(end), size - 1) if begin and end else size - 1
    if first > last:
        return HttpResponse(status=416, headers={"Content-Range": f"bytes */{size}"})
    part = {"Accept-Ranges": "bytes", "Content-Range": f"bytes {first}-{last}/{size}"}
    return HttpResponse(content[first : last + 1], status=206, content_type=kind, headers=part)
