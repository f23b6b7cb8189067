"""Two studies whose answers are known. In the first, every participant drives with and without
assistance, on the usual page and on the one for novices, and bots have opinions that depend on it
as `EFFECTS` say.

- Workload (raw NASA-TLX): assistance lowers it: a main effect.
- Usability (SUS): assistance is liked on the usual page alone: an interaction, and none of the two
  by itself.
- Likeability (Godspeed) rises from drive to drive: an effect of order.
- Speed: bots drive slower on the page for novices. (What assistance does to driving is no plant.)

Nothing else is planted: neither in these scores, nor in the other four of the Godspeed, nor in the
statements of Table 5.

In the second, the outcomes are success and the time to it. Participants drive with or without a
brake at obstacles, which no page shows before the video: those who leave before it are drawn again.
A door that is not on the way is once open and once shut. Bots with the brake are slow, and many do
not finish in time; the door changes nothing.
"""

from collections.abc import Sequence
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


# Endings of the bots, in turn: of sixteen, twelve take part to the end.
ENDINGS = (*["completes"] * 12, "never_moves", "takes_the_robot_again", "lets_the_time_run_out")
ENDINGS += ("withdraws",)


def effects() -> list[Effect]:
    return [effect(text) for text in EFFECTS]


def planted_study(*, minutes: float = 2.0) -> StudyDefinition:
    """The first study: the course is over in half a minute, the questions follow each drive."""
    written = msgspec.to_builtins(short_study(minutes=minutes))
    return _study(
        written,
        ASKED,
        slug=SLUG,
        title={"en": "Assistance and page", "es": "Asistencia y página"},
        factors=[
            _factor("help", "Assistance", ASSIST.values()),
            _factor("page", "Page", PAGES.values()),
        ],
        conditions=[
            _condition(written["conditions"][0], assist, page)
            for assist, page in product(ASSIST, PAGES)
        ],
        analyses=ANALYSES,
        plan=PLAN,
    )


def _study(written: dict[str, Any], asked: Sequence[str], **fields: Any) -> StudyDefinition:
    """Return a study with other fields, whose drives and questionnaires are repeated."""
    steps = [one for one in written["steps"] if one["kind"] in {"consent", "form", "instructions"}]
    task = next(one for one in written["steps"] if one["kind"] == "task")
    asking = [
        {"kind": "questionnaire", "key": slug, "questionnaire": slug, "repeat": True}
        | {"title": {"en": slug.upper(), "es": slug.upper()}}
        for slug in asked
    ]
    thanks = next(one for one in written["steps"] if one["kind"] == "debrief")
    common = {
        "steps": [*steps, {**task, "repeat": True, "last_minutes": 0.5}, *asking, thanks],
        "allocation": {"design": "within", "order": "balanced"},
        "analysis": {"counts": "all", "interval": "t"},
    }
    return msgspec.convert({**written, **common, **fields}, StudyDefinition)


def planted_questionnaires() -> tuple[Definition, ...]:
    """What the study asks. The wording of Godspeed may not be shipped: it is asked without."""
    asked = questionnaires("ict", *ASKED)
    return tuple(msgspec.structs.replace(one, template=False) for one in asked)


def _factor(key: str, title: str, levels: Any, design: str = "within") -> dict[str, Any]:
    own = [{"key": level, "title": {"en": name, "es": name}} for level, name in levels]
    return {"key": key, "title": {"en": title, "es": title}, "design": design, "levels": own}


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


# --- the second study: success, and the time to it ------------------------------------------------

SUCCESS_SLUG = "planted-success"
SUCCESS_EFFECTS = ["pace@assist=slow:-6.0"]
SUCCESS_ENDINGS = (*["completes"] * 7, "leaves_midway", "never_moves", "takes_the_robot_again")
SUCCESS_MINUTES = 0.95  # enough for a bot without the brake, if the computer is not late
CHECKPOINT = {"x": 5.0, "y": 3.0}
DOORS = {(): ("open", "Door open"), ("lounge-door",): ("shut", "Door shut")}
BRAKE = {"off": ("alone", "Alone"), "slow": ("braked", "Braked")}
SUCCESS_PLANTED = {("completed", "help"), ("task_time", "help")}


def success_study(*, minutes: float = SUCCESS_MINUTES) -> StudyDefinition:
    """The second study: a longer course, and too little time for slow drivers."""
    written = msgspec.to_builtins(short_study(minutes=minutes))
    (course,) = written["courses"]
    dock, near = course["checkpoints"]
    return _study(
        written,
        ["experience"],
        slug=SUCCESS_SLUG,
        title={"en": "Brake and door", "es": "Freno y puerta"},
        factors=[
            _factor("door", "Door", DOORS.values()),
            _factor("help", "Brake", BRAKE.values(), "between"),
        ],
        courses=[{**course, "checkpoints": [dock, {**near, **CHECKPOINT}]}],
        conditions=[
            _braked(written["conditions"][0], assist, shut)
            for assist, shut in product(BRAKE, DOORS)
        ],
        analyses=[
            _analysis("success", "Success", measures=["completed"], **_by_contrasts("proportions")),
            _analysis("times", "Times", measures=["task_time"], **_by_contrasts("times")),
            _analysis("success_model", "Success, by factors", **_by_effects("proportions")),
            _analysis("times_model", "Times, by factors", **_by_effects("times")),
        ],
        plan=SUCCESS_PLAN,
    )


def _braked(usual: dict[str, Any], assist: str, shut: tuple[str, ...]) -> dict[str, Any]:
    (brake, brake_title), (door, door_title) = BRAKE[assist], DOORS[shut]
    title = f"{door_title}, {brake_title}"
    return {
        **usual,
        "key": f"{door}_{brake}",
        "title": {"en": title, "es": title},
        "levels": {"door": door, "help": brake},
        "assist": assist,
        "doors_closed": shut,
    }


def _by_contrasts(test: str) -> dict[str, Any]:
    """Contrasts of different participants with a drive each and with two, and of the same ones."""
    alone, braked = ["open_alone", "shut_alone"], ["open_braked", "shut_braked"]
    pairs = [
        _contrast("Alone − braked", alone, braked),
        _contrast("Alone − braked, door open", alone[:1], braked[:1]),
        _contrast("Alone − braked, door shut", alone[1:], braked[1:]),
        _contrast("Door open − shut, alone", alone[:1], alone[1:]),
        _contrast("Door open − shut, braked", braked[:1], braked[1:]),
    ]
    return {"test": test, "contrasts": pairs}


def _by_effects(test: str) -> dict[str, Any]:
    measure = {"proportions": "completed", "times": "task_time"}[test]
    effects = ["help", "door", "help:door"]
    return {"measures": [measure], "test": test, "effects": effects, "coding": "sum"}


def _success_hypothesis(key: str, text: str, measure: str, effect: str) -> dict[str, Any]:
    analysis = {"completed": "success_model", "task_time": "times_model"}[measure]
    about = {"analysis": analysis, "measures": [measure], "effect": effect}
    return {"key": key, "text": text, **about}


SUCCESS_PLAN = {
    "question": "What do brake and door change?",
    "hypotheses": [
        _success_hypothesis("h1", "The brake changes success.", "completed", "help"),
        _success_hypothesis("h2", "The brake changes the time.", "task_time", "help"),
        _success_hypothesis("h3", "The door changes success.", "completed", "door"),
        _success_hypothesis("h4", "The door changes the time.", "task_time", "door"),
    ],
    "families": [{"key": "all", "hypotheses": ["h1", "h2", "h3", "h4"]}],
    "participants": 40,
}
