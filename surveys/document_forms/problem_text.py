"""Problems of a document as sentences for people; those of missing texts name all languages at
once.
"""

from collections.abc import Callable, Iterable, Sequence

from django.utils.translation import gettext as _

from surveys.document_forms.fields import language_name
from surveys.document_forms.guide import FormGuide
from surveys.document_forms.parts import Document
from surveys.documents import Problem, ProblemPlace

ByPlace = dict[ProblemPlace, list[str]]


def sentences(found: Iterable[Problem | str]) -> list[str]:
    return [one.sentence(_) if isinstance(one, Problem) else one for one in found]


def by_place(
    found: Iterable[Problem], sentence: Callable[[Problem], str], name_of: Callable[[Problem], str]
) -> ByPlace:
    """Return the sentences of problems by place; `name_of` returns the name of a missing text."""
    places: dict[ProblemPlace, dict[str, list[str]]] = {}
    for one in found:
        languages = places.setdefault(one.place, {})
        if one.language:
            languages.setdefault(name_of(one), []).append(language_name(one.language))
        else:
            languages[sentence(one)] = []
    return {place: [_missing(*one) for one in texts.items()] for place, texts in places.items()}


def _missing(text: str, languages: Sequence[str]) -> str:
    words = {"text": text, "languages": ", ".join(languages)}
    return _("%(text)s (%(languages)s) is missing.") % words if languages else text


def text_name(
    guide: FormGuide,
    part: Document | None,
    path: Iterable[str | int],
    title: Callable[[Document], str] = lambda _part: "",
) -> str:
    """Return the labels on the path to a text; of a part of a list, its title or number."""
    names: list[str] = []
    here, called = part or {}, ""
    for step in path:
        here = here[step] if isinstance(step, int) else here.get(step, {})
        if isinstance(step, int):
            n = here.get("number", step + 1)
            names[-1] = title(here) or f"{guide.item(called)} {n}"
        else:
            called = step
            names.append(str(guide.label(step)))
    return " · ".join(names)
