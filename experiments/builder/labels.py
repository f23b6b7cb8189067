"""The words of the study builder: labels and hints of fields (fields.csv, with their layout), and
what can be chosen (choices.csv).
"""

from typing import TypeAlias

from django.utils.functional import Promise
from django.utils.text import capfirst
from django.utils.translation import gettext_lazy as _, gettext_lazy as translated, pgettext_lazy

from experiments.definition.coding import CodingScheme
from experiments.definition.factors import SETTING_NAMES
from experiments.definition.plan import Hypothesis
from experiments.definition.schema import Condition, StudyCheckpoint
from experiments.definition.step import AskingStep
from experiments.definition.wizard import Wizard, WizardStep
from experiments.recruitment.sites import PROFILES
from surveys.document_forms.guide import FormGuide, column_of, word_table, words_by_kind
from surveys.editor.labels import CHOICES as SURVEY_CHOICES

Words: TypeAlias = str | Promise
# Settings without a button for a new factor.
RARE_FACTORS = frozenset({"video_jitter", "control_jitter", "control_way", "angular"})
SETTINGS = {name: capfirst(translated(words)) for name, words in SETTING_NAMES.items()}
FACTORS = {name: words for name, words in SETTINGS.items() if name not in RARE_FACTORS}

CHOICES: dict[str, dict[str, Words]] = words_by_kind(__file__, "choices.csv", translated)
ENDING_NAMES = CHOICES["returning"]
CHOICES |= {
    "changes": SETTINGS,
    "outcomes": SURVEY_CHOICES["outcome"],
    "Recruiting.site": {
        "any": _("any"),
        **{name: profile.title for name, profile in PROFILES.items()},
        "other": _("another one"),
    },
    "devices": {
        "computer": pgettext_lazy("a device", "computer"),
        "tablet": pgettext_lazy("a device", "tablet"),
        "phone": pgettext_lazy("a device", "phone"),
    },
}

_FIELDS = word_table(__file__, "fields.csv")


def _with_form(form: str) -> frozenset[str]:
    return frozenset(row["field"] for row in _FIELDS if row["form"] == form)


LABELS = {
    **column_of(_FIELDS, "label", translated),
    "site": pgettext_lazy("a building", "Site"),
    **{f"EndingCodes.{name}": words for name, words in ENDING_NAMES.items()},
}
GUIDE = FormGuide(
    LABELS,
    column_of(_FIELDS, "hint", translated),
    column_of(_FIELDS, "item", translated)
    | {"leaves": pgettext_lazy("of the instructions", "Page")},
    CHOICES,
    kinds={
        "WizardStage.steps": {"": _("Line")} | CHOICES["move"],
        "StudyDesign.factors": FACTORS | {"": _("Something else")},
    },
    hidden={
        StudyCheckpoint: frozenset({"number"}),  # its place in the list says it
        # Lists whose parts have pages of their own.
        Wizard: frozenset({"stages"}),
        CodingScheme: frozenset({"codes"}),
        AskingStep: frozenset({"version"}),  # chosen with the questionnaire
        Hypothesis: frozenset({"analysis", "contrast", "effect"}),  # chosen with the direction
        Condition: frozenset({"levels"}),  # they follow from the design
    },
    instead={WizardStep: {"move": frozenset({"line", "aloud"})}},
    details=_with_form("folded"),
    long=_with_form("long"),
    spaced=_with_form("spaced"),
    angles=_with_form("angle"),
)
