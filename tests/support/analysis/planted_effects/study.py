"""A study whose answers are known: every participant drives with and without assistance, on the
usual page and on the one for novices, and bots have opinions that depend on it as `EFFECTS` say.

- Workload (raw NASA-TLX): assistance lowers it: a main effect.
- Usability (SUS): assistance is liked on the usual page alone: an interaction, and none of the two
  by itself.
- Likeability (Godspeed) rises from drive to drive: an effect of order.
- Speed: bots drive slower on the page for novices. (What assistance does to driving is no plant.)

Nothing else is planted: neither in these scores, nor in the other four of the Godspeed, nor in the
statements of Table 5.
"""

from itertools import product
from typing import Any

import msgspec

from experiments.bots.persona import Effect, effect
from experiments.definition.schema import StudyDefinition
from surveys.definition import Definition
from tests.support.analysis.study_dataset import questionnaires
from tests.support.studies.short_study import short_study

SLUG = "planted"
ASKED = ("tlx", "sus", "godspeed", "experience")
TLX = ("mental", "physical", "temporal", "performance", "effort", "frustration")
LIKEABILITY = [f"item{n}" for n in range(12, 17)]
EFFECTS = [
    *(f"{item}@assist=steer:-0.8" for item in TLX),
    *(
        f"sus{n}@assist={assist},interface={page}:{'' if n % 2 else '-'}0.9"
        for n in range(1, 11)
        for assist, page in (("steer", "standard"), ("off", "novice"))
    ),
    *(f"{item}@drive={n}:{0.5 * (n - 1)}" for item in LIKEABILITY for n in (2, 3, 4)),
    "pace@interface=novice:-4.0",
]
ASSIST = {"off": ("alone", "Alone"), "steer": ("assisted", "Assisted")}
PAGES = {"standard": ("usual", "usual page"), "novice": ("novice", "page for novices")}
SCORES = [
    "tlx.overall",
    "sus.overall",
    *(
        f"godspeed.{topic}"
        for topic in ("anthropomorphism", "animacy", "likeability", "intelligence", "safety")
    ),
    "experience.overall",
]
TERMS = ["help", "page", "help:page", "period"]
# The tests of `answers` in which something was planted.
PLANTED = {
    ("tlx.overall", "help"),
    ("sus.overall", "help:page"),
    ("godspeed.likeability", "period"),
}


def effects() -> list[Effect]:
    return [effect(text) for text in EFFECTS]


def planted_study(*, minutes: float = 5.0) -> StudyDefinition:
    """The study: the course is over in half a minute, the questions follow each drive."""
    written = msgspec.to_builtins(short_study(minutes=minutes))
    steps = [one for one in written["steps"] if one["kind"] in {"consent", "form", "instructions"}]
    task = next(one for one in written["steps"] if one["kind"] == "task")
    asked = [
        {"kind": "questionnaire", "key": slug, "questionnaire": slug, "repeat": True}
        | {"title": {"en": slug.upper(), "es": slug.upper()}}
        for slug in ASKED
    ]
    thanks = next(one for one in written["steps"] if one["kind"] == "debrief")
    return msgspec.convert(
        {
            **written,
            "slug": SLUG,
            "title": {"en": "Assistance and page", "es": "Asistencia y página"},
            "steps": [*steps, {**task, "repeat": True}, *asked, thanks],
            "factors": [
                _factor("help", "Assistance", ASSIST.values()),
                _factor("page", "Page", PAGES.values()),
            ],
            "conditions": [
                _condition(written["conditions"][0], assist, page)
                for assist, page in product(ASSIST, PAGES)
            ],
            "allocation": {"design": "within", "order": "balanced"},
            "analysis": {"counts": "all", "interval": "t"},
            "analyses": ANALYSES,
            "plan": PLAN,
        },
        StudyDefinition,
    )


def planted_questionnaires() -> tuple[Definition, ...]:
    """What the study asks. The wording of Godspeed may not be shipped: it is asked without."""
    asked = questionnaires("ict", *ASKED)
    return tuple(msgspec.structs.replace(one, template=False) for one in asked)


def _factor(key: str, title: str, levels: Any) -> dict[str, Any]:
    own = [{"key": level, "title": {"en": name, "es": name}} for level, name in levels]
    return {"key": key, "title": {"en": title, "es": title}, "design": "within", "levels": own}


def _condition(usual: dict[str, Any], assist: str, page: str) -> dict[str, Any]:
    (help_key, help_title), (page_key, page_title) = ASSIST[assist], PAGES[page]
    title = f"{help_title}, {page_title}"
    return {
        **usual,
        "key": f"{help_key}_{page_key}",
        "title": {"en": title, "es": title},
        "levels": {"help": help_key, "page": page_key},
        "assist": assist,
        "interface": page,
    }


ALONE, ASSISTED = (["alone_usual", "alone_novice"], ["assisted_usual", "assisted_novice"])


def _contrast(title: str, first: list[str], second: list[str]) -> dict[str, Any]:
    return {"title": {"en": title, "es": title}, "first": first, "second": second}


CONTRASTS = [
    _contrast("Assisted − alone", ASSISTED, ALONE),
    _contrast("Assisted − alone, usual page", ["assisted_usual"], ["alone_usual"]),
    _contrast("Assisted − alone, page for novices", ["assisted_novice"], ["alone_novice"]),
]


def _analysis(key: str, title: str, **more: Any) -> dict[str, Any]:
    return {"key": key, "title": {"en": title, "es": title}, **more}


ANALYSES = [
    _analysis("answers", "Scores", measures=SCORES, test="mixed", effects=TERMS, coding="sum"),
    _analysis(
        "driving",
        "Driving",
        measures=["speed", "task_time"],
        test="mixed",
        effects=["help", "page"],
        coding="treatment",
    ),
    _analysis("means", "Assistance, by means", measures=SCORES[:2], contrasts=CONTRASTS),
    _analysis(
        "ranks",
        "Assistance, by ranks",
        measures=[f"tlx.{item}" for item in TLX],
        test="ranks",
        contrasts=CONTRASTS[:1],
    ),
    _analysis("all_at_once", "All conditions", measures=SCORES[:2], test="ranks", post_hoc=True),
]


def _hypothesis(key: str, text: str, measure: str, effect: str) -> dict[str, Any]:
    about = {"analysis": "answers", "measures": [measure], "effect": effect}
    return {"key": key, "text": text, **about}


PLAN = {
    "question": "What do assistance and page change?",
    "hypotheses": [
        _hypothesis("h1", "Assistance changes workload.", "tlx.overall", "help"),
        _hypothesis("h2", "What assistance does depends on the page.", "sus.overall", "help:page"),
        _hypothesis("h3", "Likeability changes over drives.", "godspeed.likeability", "period"),
        _hypothesis("h4", "Animacy changes over drives.", "godspeed.animacy", "period"),
    ],
    "families": [{"key": "all", "hypotheses": ["h1", "h2", "h3", "h4"]}],
    "participants": 24,
}
