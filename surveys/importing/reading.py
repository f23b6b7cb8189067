"""Reading a file of any known format in a child process."""

from typing import Any

import msgspec
from django.utils.translation import gettext as _

from robots.files.limited_process import ImportRefusedError, run_limited
from surveys.definition import Definition
from surveys.document_forms.problem_text import sentences
from surveys.documents import BadDefinitionError, ascii_name
from surveys.importing.draft import Draft
from surveys.importing.formats import FORMATS
from surveys.importing.report import ImportReport

MAX_FILE = 5 * 1024 * 1024
MAX_SLUG = 40


class ImportedSurvey(msgspec.Struct, frozen=True):
    """A questionnaire, named by its title, and a report; `problems` say why there is none."""

    slug: str
    report: ImportReport
    definition: Definition | None = None
    problems: list[str] = []


def import_survey(document: bytes, language: str, form: str, slug: str = "") -> ImportedSurvey:
    """Return what a child process reads from a file; `slug` replaces the name by its title. Raises
    BadDefinitionError for a file that is too large, of no known format, or cannot be read.
    """
    try:
        found = run_limited(read_plain, document, language, form, slug)
    except ImportRefusedError as error:
        raise BadDefinitionError(error.problems) from error
    return msgspec.convert(found, ImportedSurvey)


def read_plain(document: bytes, language: str, form: str, slug: str) -> Any:
    draft = read(document, language, form)
    name = slug or slug_for(next(iter(draft.title.values()), ""))
    try:
        found = ImportedSurvey(name, draft.report, draft.definition(name, 1))
    except BadDefinitionError as error:
        found = ImportedSurvey(name, draft.report, problems=sentences(error.problems))
    return msgspec.to_builtins(found)


def read(document: bytes, language: str = "en", form: str = "") -> Draft:
    """Return the draft of a file of any format; raises as `import_survey`."""
    if len(document) > MAX_FILE:
        words = _("The file is larger than %(n)d MB.") % {"n": MAX_FILE // 1024**2}
        raise BadDefinitionError([words])
    if document.startswith(b"PK\x03\x04"):
        words = _("This is a ZIP archive. Unpack it, and import the .qsf, .lss or .csv file in it.")
        raise BadDefinitionError([words])
    for one in FORMATS.values():
        if one.is_in(document):
            survey = one(document, language, form)
            survey.convert()
            survey.into.finish()
            return survey.into
    known = {"formats": ", ".join(one.label for one in FORMATS.values())}
    raise BadDefinitionError([_("The file has none of these formats: %(formats)s.") % known])


def slug_for(title: str) -> str:
    words = ascii_name(title, "-")
    slug = words if words[:1].isalpha() else f"survey-{words}"
    return slug[:MAX_SLUG].strip("-")
