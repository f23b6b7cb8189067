"""How participants of a study are recruited, screened and invited: the optional parts of a
definition that deal with people before and after they drive.
"""

import re
from collections.abc import Iterable, Iterator
from typing import Annotated, Any, Literal, get_args

from msgspec import Meta

from surveys.documents import DocumentPart, Key, Problem, Slug
from surveys.documents import gettext_noop as _

# How taking part ended. `left`: the participant gave up before the robot moved, or withdrew.
Ending = Literal["done", "timed_out", "technical_failure", "screened_out", "left"]
ENDINGS: tuple[Ending, ...] = get_args(Ending)
RecruitmentSite = Literal["any", "prolific", "mturk", "sona", "cloudresearch", "other"]
Code = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{0,20}\Z")]
DeviceKind = Literal["computer", "tablet", "phone"]
Browser = Literal["Chrome", "Chromium", "Edge", "Firefox", "Opera", "Safari", "Samsung Internet"]
# What a return address may contain in braces, and how an address with nothing else begins.
PLACEHOLDERS = ("code", "id", "session")
_PLACEHOLDER = re.compile(r"{([^{}]*)}")
_ADDRESS = re.compile(r"https://[A-Za-z0-9.-]+(:\d+)?/[^\s<>\"\\]*\Z")


class EndingCodes(DocumentPart, frozen=True, kw_only=True):
    """The code of each ending. An empty one is made by this site and stays the same in all versions
    of the study.
    """

    done: Code = ""
    timed_out: Code = ""
    technical_failure: Code = ""
    screened_out: Code = ""
    left: Code = ""


class Recruiting(DocumentPart, frozen=True, kw_only=True):
    """Where participants are recruited. The parameter `id_parameter` of the link recognizes them
    (empty: that of the site), and `return_address` is where they go at the end (empty: that of the
    site), with {code}, {id} and {session} filled in. Only the endings in `returning` lead there;
    none means all.
    """

    site: RecruitmentSite = "any"
    id_parameter: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{0,40}\Z")] = ""
    return_address: Annotated[str, Meta(max_length=500)] = ""
    returning: tuple[Ending, ...] = ()
    codes: EndingCodes = EndingCodes()


class AnswerRule(DocumentPart, frozen=True, kw_only=True):
    """An answer that participants need: one of `answers`, or a number within bounds. Any other
    answer, and none, screens them out.
    """

    questionnaire: Slug
    item: Key
    answers: Annotated[tuple[str, ...], Meta(max_length=100)] = ()
    at_least: float | None = None
    at_most: float | None = None


class AnswerQuota(DocumentPart, frozen=True, kw_only=True):
    """At most `most` participants who give one of these answers; later ones are screened out."""

    questionnaire: Slug
    item: Key
    answers: Annotated[tuple[str, ...], Meta(max_length=100)] = ()
    most: Annotated[int, Meta(ge=0, le=100_000)] = 10


class Appointments(DocumentPart, frozen=True, kw_only=True):
    """Participants choose when they drive: one at a time on each robot, `minutes` each, within the
    study's opening hours and up to `days_ahead` days ahead. A reminder is sent `reminder_hours`
    before. With `second_after_days`, who has finished a first visit is invited to a second one by
    e-mail after that many days. With `required`, only participants with an appointment drive.
    """

    required: bool = True
    minutes: Annotated[int, Meta(ge=5, le=240)] = 30
    days_ahead: Annotated[int, Meta(ge=1, le=60)] = 14
    reminder_hours: Annotated[float, Meta(ge=0.5, le=168.0)] = 24.0
    second_after_days: Annotated[int, Meta(ge=1, le=365)] | None = None


# --- problems -------------------------------------------------------------------------------------


def recruiting_problems(one: Recruiting) -> Iterator[Problem]:
    """Yield the problems of a recruitment site."""
    if one.site == "other" and not one.id_parameter:
        yield Problem(_("Enter the parameter of the link that has the participant's id."))
    if one.site in {"other", "sona", "cloudresearch"} and not one.return_address:
        yield Problem(_("Enter the return address that the recruitment site shows."))
    if one.return_address:
        if not _ADDRESS.match(one.return_address):
            yield Problem(_("The return address must begin with https:// and have no spaces."))
        unknown = set(_PLACEHOLDER.findall(one.return_address)) - set(PLACEHOLDERS)
        if unknown:
            words = _("The return address may contain {code}, {id} and {session}, not %(names)s.")
            yield Problem(words, {"names": ", ".join(f"{{{name}}}" for name in sorted(unknown))})
    given = [code for name in ENDINGS if (code := getattr(one.codes, name))]
    if one.codes.done and given.count(one.codes.done) > 1:
        words = _("Another ending has the code of completion, so it would be paid as completed.")
        yield Problem(words)


def screening_problems(
    rules: Iterable[AnswerRule], quotas: Iterable[AnswerQuota], asked: Iterable[str]
) -> Iterator[Problem]:
    """Yield the problems of rules and quotas; `asked` are the study's questionnaires."""
    known = set(asked)
    both: tuple[AnswerRule | AnswerQuota, ...] = (*rules, *quotas)
    for one in both:
        if one.questionnaire not in known:
            words = _("the study does not ask the questionnaire %(name)s.")
            yield Problem(words, {"name": one.questionnaire})
        has_bounds = isinstance(one, AnswerRule) and (one.at_least, one.at_most) != (None, None)
        if not one.answers and not has_bounds:
            words = _("the rule on the answer to %(item)s names no answer.")
            yield Problem(words, {"item": one.item})


def admits(rule: AnswerRule, value: Any) -> bool:
    """Tell whether an answer meets a rule. None is no answer, which meets none; of several choices
    one must be named. Numbers compare as numbers.
    """
    if value is None:
        return False
    if rule.answers and not names_answer(rule.answers, value):
        return False
    if rule.at_least is None and rule.at_most is None:
        return True
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    above = rule.at_least is None or value >= rule.at_least
    return above and (rule.at_most is None or value <= rule.at_most)


def names_answer(answers: Iterable[str], value: Any) -> bool:
    """Tell whether answers, as a definition writes them, contain a stored value."""
    given = value if isinstance(value, list | tuple) else [value]
    return not {as_text(one) for one in given}.isdisjoint(answers)


def as_text(value: Any) -> str:
    """Return a stored value as a definition writes it: 3 for 3.0."""
    return str(int(value)) if isinstance(value, float) and value.is_integer() else str(value)
