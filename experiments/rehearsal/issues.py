"""The issues that a rehearsal finds, and the sentence of each kind, which pages translate."""

from dataclasses import dataclass, field
from typing import Any

gettext_noop = str  # marks a text for the catalogue

# These prevent publishing.
PROBLEMS = {
    "not_completed": gettext_noop("No bot completed the task (drives: %(drives)s)."),
    "missed": gettext_noop("No bot passed checkpoint %(number)s."),
    "too_short": gettext_noop(
        "The slowest bot took %(minutes)s minutes. A limit of %(limit)s minutes is too short for "
        "people: allow %(allow)s."
    ),
    "not_applied": gettext_noop("A setting was not applied as assigned: %(what)s."),
    "no_task": gettext_noop("There is no task to drive."),
    "stuck": gettext_noop("Bot %(bot)s got stuck: %(where)s."),
    "no_code": gettext_noop("Bot %(bot)s finished the study but got no completion code."),
    "not_drawn": gettext_noop("Not drawn: %(what)s."),
    "differs": gettext_noop("A drive was not recorded as it happened. %(what)s"),
}
# These do not.
NOTES = {
    "empty": gettext_noop("No bot gave a value for %(column)s."),
    "unseen_door": gettext_noop("No bot came to %(door)s, which is closed."),
}


@dataclass(frozen=True)
class Issue:
    """One issue: its kind, the values in its sentence, and the key of the condition that it is
    about, if any. `place` is the heading of the page where it is corrected.
    """

    kind: str
    values: dict[str, Any] = field(default_factory=dict)
    condition: str = ""
    place: str = ""

    @property
    def is_problem(self) -> bool:
        return self.kind in PROBLEMS

    @property
    def template(self) -> str:
        """Its sentence, not filled in, so that it can be translated."""
        return (PROBLEMS | NOTES)[self.kind]

    def sentence(self) -> str:
        """Return it in English, for the command."""
        sentence = self.template % self.values
        return f"Condition {self.condition}: {sentence}" if self.condition else sentence
