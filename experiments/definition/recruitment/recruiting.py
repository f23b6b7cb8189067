"""How participants are recruited, screened and invited: optional parts of a definition."""

import re
from collections.abc import Container, Iterable, Iterator
from typing import Annotated, Any, Literal, get_args

from msgspec import Meta

from surveys.documents import DocumentPart, Key, Problem, Slug, gettext_noop as _

# How taking part ended. `left`: before the task was completed or its time over, or withdrawn.
Ending = Literal["done", "timed_out", "technical_failure", "screened_out", "left"]
ENDINGS: tuple[Ending, ...] = get_args(Ending)
RecruitmentSite = Literal["any", "prolific", "mturk", "sona", "cloudresearch", "other"]
Code = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{0,20}\Z")]
DeviceKind = Literal["computer", "tablet", "phone"]
Browser = Literal["Chrome", "Chromium", "Edge", "Firefox", "Opera", "Safari", "Samsung Internet"]
PLACEHOLDERS = ("code", "id", "session")
_PLACEHOLDER = re.compile(r"{([^{}]*)}")
_ADDRESS = re.compile(r"https://[A-Za-z0-9.-]+(:\d+)?/[^\s<>\"\\]*\Z")


class EndingCodes(DocumentPart, frozen=True, kw_only=True):
    """The completion codes; empty ones are generated, and the same in all versions."""

    done: Code = ""
    timed_out: Code = ""
    technical_failure: Code = ""
    screened_out: Code = ""
    left: Code = ""


class Recruiting(DocumentPart, frozen=True, kw_only=True):
    """`id_parameter` is the parameter of the link with the participant's id, `return_address` the
    address at the end, with {code}, {id} and {session} filled in; empty: those of the site. Only
    the endings in `returning` lead there (empty: all).
    """

    site: RecruitmentSite = "any"
    id_parameter: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{0,40}\Z")] = ""
    return_address: Annotated[str, Meta(max_length=500)] = ""
    returning: tuple[Ending, ...] = ()
    codes: EndingCodes = EndingCodes()


class AnswerRule(DocumentPart, frozen=True, kw_only=True):
    """Any answer but one of `answers` or a number within bounds screens the participant out."""

    questionnaire: Slug
    item: Key
    answers: Annotated[tuple[str, ...], Meta(max_length=100)] = ()
    at_least: float | None = None
    at_most: float | None = None


class AnswerQuota(DocumentPart, frozen=True, kw_only=True):
    """At most `most` participants with one of these answers; later ones are screened out."""

    questionnaire: Slug
    item: Key
    answers: Annotated[tuple[str, ...], Meta(max_length=100)] = ()
    most: Annotated[int, Meta(ge=0, le=100_000)] = 10


class Appointments(DocumentPart, frozen=True, kw_only=True):
    """Participants book when they drive, one at a time on each robot, within the study's opening
    hours. With `required`, only they drive. `second_after_days`: finished participants are invited
    to a second session by e-mail.
    """

    required: bool = True
    minutes: Annotated[int, Meta(ge=5, le=240)] = 30
    days_ahead: Annotated[int, Meta(ge=1, le=60)] = 14
    reminder_hours: Annotated[float, Meta(ge=0.5, le=168.0)] = 24.0
    second_after_days: Annotated[int, Meta(ge=1, le=365)] | None = None


def recruiting_problems(one: Recruiting) -> Iterator[Problem]:
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
    rules: Iterable[AnswerRule],
    quotas: Iterable[AnswerQuota],
    asked: Container[str],
    before_task: Container[str],
) -> Iterator[Problem]:
    both: tuple[AnswerRule | AnswerQuota, ...] = (*rules, *quotas)
    for one in both:
        if one.questionnaire not in asked:
            words = _("the study does not ask the questionnaire %(name)s.")
            yield Problem(words, {"name": one.questionnaire})
        elif one.questionnaire not in before_task:
            words = _(
                "the study asks the questionnaire %(name)s only after the task, when nobody is"
                " turned away any more: ask it before."
            )
            yield Problem(words, {"name": one.questionnaire})
        has_bounds = isinstance(one, AnswerRule) and (one.at_least, one.at_most) != (None, None)
        if not one.answers and not has_bounds:
            words = _("the rule on the answer to %(item)s names no answer.")
            yield Problem(words, {"item": one.item})


def admits(rule: AnswerRule, value: Any) -> bool:
    """Tell whether an answer (one of several choices) meets a rule; None, no answer, meets none."""
    if value is None or (rule.answers and not names_answer(rule.answers, value)):
        return False
    if rule.at_least is None and rule.at_most is None:
        return True
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    above = rule.at_least is None or value >= rule.at_least
    return above and (rule.at_most is None or value <= rule.at_most)


def names_answer(answers: Iterable[str], value: Any) -> bool:
    """Tell whether answers of a definition contain a stored value."""
    given = value if isinstance(value, list | tuple) else [value]
    return not {as_text(one) for one in given}.isdisjoint(answers)


def as_text(value: Any) -> str:
    """Return a stored value as definitions have it: "3" for 3.0."""
    return str(int(value)) if isinstance(value, float) and value.is_integer() else str(value)
