"""The questions of a LimeSurvey file, by their one-letter types, as questions of this site.

The letters are those of LimeSurvey's `Question` model. A letter without an entry in `TYPES` has no
counterpart.
"""

from collections.abc import Callable

from django.utils.translation import gettext as _

from surveys.importing.draft import Item
from surveys.importing.limesurvey.arrays import array, cells, two_scales
from surveys.importing.limesurvey.choices import five_points, fixed, multiple, ranking, single
from surveys.importing.limesurvey.entries import day, free_text, number, numbers, texts
from surveys.importing.limesurvey.question import LimeSurveyConversion
from surveys.importing.report import NotImportedError

TYPES: dict[str, Callable[[LimeSurveyConversion], list[Item]]] = {
    **dict.fromkeys("L!O", single),
    **dict.fromkeys("YG", fixed),
    **dict.fromkeys("MP", multiple),
    **dict.fromkeys("ABCEFH", array),
    **dict.fromkeys(":;", cells),
    **dict.fromkeys("STU", free_text),
    "1": two_scales,
    "5": five_points,
    "D": day,
    "K": numbers,
    "N": number,
    "Q": texts,
    "R": ranking,
}
NAMES = {"|": "file upload", "*": "equation", "I": "language switch"}


def items_of(asked: LimeSurveyConversion) -> list[Item]:
    """Return what a question becomes.

    Raises:
        NotImportedError: it has no counterpart here.
    """
    converter = TYPES.get(asked.question.type)
    if converter is None:
        kind = NAMES.get(asked.question.type, asked.question.type)
        raise NotImportedError(
            _("Questions of the type %(kind)s are not supported.") % {"kind": kind}
        )
    return converter(asked)
