"""A small study with a participant for every course and end of participation."""

from dataclasses import replace

from experiments.dataset.records import (
    Dataset,
    PageRecord,
    ParticipantRecord,
    ResponseRecord,
    SessionRecord,
)
from tests.support.analysis.planned import planned_study
from tests.support.analysis.study_dataset import questionnaires
from tests.support.studies.studies import STUDY


def drive(who: str, condition: str = "shut", visit: int = 1, **changes) -> SessionRecord:
    """A completed drive of a participant, with fields replaced."""
    one = SessionRecord(
        f"{who}-{visit}",
        who,
        "giraff",
        visit=visit,
        condition=condition,
        outcome="completed",
        first_frame=1.0,
        first_motion=3.0,
    )
    return replace(one, **changes)


NEVER = float("nan")
BYE = {"kind": "debrief", "key": "thanks", "title": {"en": "Bye"}, "text": {"en": "Thanks"}}
PEOPLE = (
    ParticipantRecord("done", cell="shut", place="filled", finished=True),
    ParticipantRecord("declined", left="declined"),
    ParticipantRecord("waiting", cell="shut", place="under_way", reached="task"),
    ParticipantRecord("frozen", cell="shut", place="freed", left="cancelled"),
    ParticipantRecord("still", cell="shut", place="filled", finished=True),
    ParticipantRecord("late", cell="all_open", place="filled", finished=True),
    ParticipantRecord("withdrew", cell="shut", place="filled", stage="answered", withdrawn=True),
    ParticipantRecord("anew", cell="all_open", first_cell="shut", draws=2, place="filled"),
    ParticipantRecord("again", cell="all_open", place="filled", finished=True),
    ParticipantRecord("replaced", cell="all_open", place="refilled", left="robot_fault"),
    ParticipantRecord("fault", cell="shut", place="filled", left="connection_lost"),
    ParticipantRecord("visitor", cell="shut", place="filled", finished=True),
    ParticipantRecord("pilot", kind="pilot", cell="shut", place="filled", finished=True),
    ParticipantRecord("bot", kind="bot", cell="shut", place="filled", finished=True),
)
SESSIONS = (
    drive("done", id="practice", practice=True),
    drive("done"),
    drive("waiting", outcome=""),
    drive("frozen", first_frame=NEVER, first_motion=NEVER, outcome="connection_refused"),
    drive("still", first_motion=NEVER, outcome="cancelled"),
    drive("late", "all_open", outcome="timed_out"),
    drive("anew", id="anew-0", first_frame=NEVER, first_motion=NEVER, outcome="cancelled"),
    drive("anew", "all_open"),
    drive("again", "all_open", 1),
    drive("again", "all_open", 2),
    drive("replaced", "all_open", outcome="robot_fault", fault_side="robot"),
    drive("fault", outcome="connection_lost", fault_side="platform", fault_part="web_process"),
    drive("visitor", excluded="a visitor looked on"),
    drive("pilot", kind="pilot"),
    drive("bot", kind="bot"),
)


def every_ending(plan: dict | None = None, **changes) -> Dataset:
    """The study; each drive has an answer about it, with the number of the drive among all."""
    return Dataset(
        planned_study(plan, **{"steps": [*STUDY["steps"], BYE], **changes}),
        participants=PEOPLE,
        sessions=SESSIONS,
        pages=tuple(PageRecord(one.id, "thanks", finished=False) for one in PEOPLE if one.finished),
        responses=tuple(
            ResponseRecord(f"r-{one.id}", "experience", one.participant, {"q1": 1}, session=one.id)
            for one in SESSIONS
        ),
        questionnaires=questionnaires("experience"),
    )
