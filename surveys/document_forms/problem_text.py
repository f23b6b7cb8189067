"""What is wrong with a document, as the pages say it on which it is corrected: a missing text is
named as the forms name it, once for all languages in which it is missing.
"""

from collections.abc import Callable, Iterable

from django.utils.translation import gettext as _

from surveys.document_forms.fields import language_name
from surveys.document_forms.guide import FormGuide
from surveys.document_forms.parts import Document
from surveys.documents import Problem, ProblemPlace

ByPlace = dict[ProblemPlace, list[str]]


def sentences(found: Iterable[Problem | str]) -> list[str]:
    """Return a sentence for each problem in the language of the page."""
    return [one.sentence(_) if isinstance(one, Problem) else one for one in found]


def by_place(
    found: Iterable[Problem], say: Callable[[Problem], str], name_of: Callable[[Problem], str]
) -> ByPlace:
    """Return what is said of problems by their places: by `say`, and of missing texts by what each
    of them is called.
    """
    places: dict[ProblemPlace, dict[str, list[str]]] = {}
    for one in found:
        said = places.setdefault(one.place, {})
        if one.language:
            said.setdefault(name_of(one), []).append(language_name(one.language))
        else:
            said[say(one)] = []
    missing = _("%(text)s (%(languages)s) is missing.")
    return {
        place: [
            missing % {"text": text, "languages": ", ".join(languages)} if languages else text
            for text, languages in said.items()
        ]
        for place, said in places.items()
    }


def text_name(
    guide: FormGuide,
    part: Document | None,
    path: Iterable[str | int],
    title: Callable[[Document], str] = lambda _part: "",
) -> str:
    """Return what a text in a part is called: the labels on its path, and of a part of a list its
    title, if it has one, or its number.
    """
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
