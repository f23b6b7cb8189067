"""The small study of tests/support/studies/studies.py with a hidden operator."""

import copy

from tests.support.studies.studies import STUDY, small_study

OPERATOR_TEXT = "A person in another room drove the robot and spoke for it."


def _titled(key, title, **more):
    return {"key": key, "title": {"en": title}, **more}


BACKWARDS = {"kind": "drive", "linear": -0.2, "seconds": 2.0}
WELCOME = [
    _titled("hello", "Greet", shortcut="1", line={"en": "Hello, I am the robot."}),
    _titled("look", "Look down", shortcut="2", move={"kind": "tilt", "angle": 0.3}),
]
TOUR = [
    _titled("leave", "Leave the station", shortcut="3", move=BACKWARDS, within=60.0),
    _titled("around", "Turn around", move={"kind": "turn"}),
    _titled("home", "Dock", move={"kind": "dock"}),
]
STAGES = [_titled("welcome", "Welcome", steps=WELCOME), _titled("tour", "Tour", steps=TOUR)]
WIZARD = {"blind": True, "participant_view": True, "stages": STAGES}


def wizard_document(*, operator=None, study=None, **wizard):
    """Return the study as a dict; `wizard` replaces fields of its part."""
    debriefing = {"en": OPERATOR_TEXT} if operator is None else operator
    whole = copy.deepcopy({**STUDY, "wizard": {**WIZARD, **wizard}, **(study or {})})
    if whole["steps"][-1]["kind"] != "debrief":
        whole["steps"].append(_titled("thanks", "T", kind="debrief", text={"en": "T"}))
    whole["steps"][-1]["operator"] = debriefing
    return whole


def wizard_study(**fields):
    """Return the study; fields as for `wizard_document`."""
    return small_study(**wizard_document(**fields))
