"""A respondent with a questionnaire in front of them."""

from typing import Any

from surveys.models import Questionnaire, Response
from surveys.responses import Context, Respondent, begin
from tests.support.studies.questionnaires import NOW

ANNA = Respondent(key="anna")


def begun(
    questionnaire: Questionnaire,
    respondent: Respondent = ANNA,
    context: Context = Context(key="c"),  # noqa: B008 -- it is frozen
    **more: Any,
) -> Response:
    """Begin a questionnaire in English at NOW; `more` replaces arguments of `begin`."""
    return begin(
        questionnaire, respondent, context, **{"language": "en", "seed": 1, "now": NOW} | more
    )
