"""Reading a file of any known format, and the name that its questionnaire may have."""

import re
import unicodedata

from django.utils.translation import gettext as _

from surveys.documents import BadDefinitionError
from surveys.importing.draft import Draft
from surveys.importing.formats import FORMATS
from surveys.importing.survey_format import Wishes

MAX_FILE = 5 * 1024 * 1024
MAX_SLUG = 40


def read(document: bytes, wishes: Wishes | None = None) -> Draft:
    """Return what a file of another system asks, of whichever format it is.

    Raises:
        BadDefinitionError: it is too large, of no known format, or cannot be read.
    """
    if len(document) > MAX_FILE:
        raise BadDefinitionError(
            [_("The file is larger than %(n)d MB.") % {"n": MAX_FILE // 1024**2}]
        )
    if document.startswith(b"PK\x03\x04"):
        raise BadDefinitionError(
            [_("This is a ZIP archive. Unpack it, and import the .qsf, .lss or .csv file in it.")]
        )
    for one in FORMATS.values():
        if one.is_in(document):
            return one.read(document, wishes or Wishes())
    known = ", ".join(one.label for one in FORMATS.values())
    raise BadDefinitionError(
        [_("The file has none of these formats: %(formats)s.") % {"formats": known}]
    )


def slug_for(title: str) -> str:
    """Return a name for a questionnaire with this title."""
    ascii_only = unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode()
    words = re.sub(r"[^a-z0-9]+", "-", ascii_only.lower()).strip("-")
    slug = words if words[:1].isalpha() else f"survey-{words}"
    return slug[:MAX_SLUG].strip("-")
