"""The small study of tests/support/studies/studies.py with a hidden operator."""

import copy

from tests.support.studies.studies import STUDY, small_study

OPERATOR_TEXT = "A person in another room drove the robot and spoke for it."
WIZARD = {
    "blind": True,
    "participant_view": True,
    "stages": [
        {
            "key": "welcome",
            "title": {"en": "Welcome"},
            "steps": [
                {
                    "key": "hello",
                    "title": {"en": "Greet"},
                    "shortcut": "1",
                    "line": {"en": "Hello, I am the robot."},
                },
                {
                    "key": "look",
                    "title": {"en": "Look down"},
                    "shortcut": "2",
                    "move": {"kind": "tilt", "angle": 0.3},
                },
            ],
        },
        {
            "key": "tour",
            "title": {"en": "Tour"},
            "steps": [
                {
                    "key": "leave",
                    "title": {"en": "Leave the station"},
                    "shortcut": "3",
                    "move": {"kind": "drive", "linear": -0.2, "seconds": 2.0},
                    "within": 60.0,
                },
                {"key": "around", "title": {"en": "Turn around"}, "move": {"kind": "turn"}},
                {"key": "home", "title": {"en": "Dock"}, "move": {"kind": "dock"}},
            ],
        },
    ],
}


def wizard_document(*, operator=None, study=None, **wizard):
    """Return the study as a dict; `wizard` replaces fields of its part."""
    debriefing = {"en": OPERATOR_TEXT} if operator is None else operator
    whole = copy.deepcopy({**STUDY, "wizard": {**WIZARD, **wizard}, **(study or {})})
    debrief = whole["steps"][-1] if whole["steps"][-1]["kind"] == "debrief" else None
    if debrief is None:
        debrief = {"kind": "debrief", "key": "thanks", "title": {"en": "T"}, "text": {"en": "T"}}
        whole["steps"] = [*whole["steps"], debrief]
    debrief["operator"] = debriefing
    return whole


def wizard_study(**fields):
    """Return the study; fields as for `wizard_document`."""
    return small_study(**wizard_document(**fields))
