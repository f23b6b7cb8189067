"""What the builder calls the fields of recruitment, screening and appointments."""

from typing import Any

from django.utils.translation import gettext_lazy as _
from django.utils.translation import pgettext_lazy

from experiments.recruitment.sites import PROFILES

ENDING_NAMES: dict[str, Any] = {
    "done": _("completed"),
    "timed_out": _("time ran out"),
    "technical_failure": _("ended by a technical failure"),
    "screened_out": _("turned away"),
    "left": _("left without driving"),
}
LABELS: dict[str, Any] = {
    "recruiting": _("Recruitment site"),
    "Recruiting.site": _("Site"),
    "id_parameter": _("Parameter with the participant's id"),
    "return_address": _("Return address"),
    "returning": _("Who returns there"),
    "Recruiting.codes": _("Codes that the site gave you"),
    **{f"EndingCodes.{name}": words for name, words in ENDING_NAMES.items()},
    "devices": _("Allowed devices"),
    "browsers": _("Allowed browsers"),
    "screening": _("Required answers"),
    "answer_quotas": _("Quotas by answer"),
    "answers": _("Answers"),
    "at_least": _("At least"),
    "at_most": _("At most"),
    "AnswerQuota.most": _("Maximum number of participants"),
    "appointments": _("Appointments"),
    "required": _("Only participants with an appointment drive"),
    "Appointments.minutes": _("Length (minutes)"),
    "days_ahead": _("Bookable days ahead"),
    "reminder_hours": _("Reminder before it (hours)"),
    "second_after_days": _("Invite to a second session after (days)"),
}
HINTS: dict[str, Any] = {
    "recruiting": _(
        "Without a site, the ids of Prolific, Mechanical Turk, Sona and CloudResearch are "
        "recognized, and participants from Prolific and Mechanical Turk return by a button."
    ),
    "id_parameter": _("Leave blank for that of the site, such as PROLIFIC_PID."),
    "return_address": _(
        "Where participants go at the end. {code}, {id} and {session} are filled in. Leave blank "
        "for that of Prolific or Mechanical Turk; Sona, CloudResearch and other sites show you one."
    ),
    "returning": _(
        "If you tick none, everyone who gets a code; on Sona and CloudResearch, only those who are "
        "usually paid."
    ),
    "Recruiting.codes": _(
        "Leave blank for codes that this site makes. They stay the same in all versions."
    ),
    "devices": _("If you tick none, all are allowed. Checked before anything is recorded."),
    "browsers": _("If you tick none, all are allowed."),
    "screening": _(
        "Participants who answer otherwise are turned away as soon as they have finished the "
        "questionnaire."
    ),
    "answer_quotas": _("Participants beyond a quota are turned away. Those who leave make room."),
    "answers": _("As in the data, separated by commas: values, not labels."),
    "appointments": _(
        "Participants choose a time within the study's opening hours; one at a time on each robot. "
        "Reminders need an e-mail server and the command send_reminders."
    ),
    "second_after_days": _("Only participants who gave an address. Leave blank for none."),
}
ITEMS: dict[str, Any] = {"screening": _("Required answer"), "answer_quotas": _("Quota")}
CHOICES: dict[str, dict[str, Any]] = {
    "Recruiting.site": {
        "any": _("any"),
        **{name: profile.title for name, profile in PROFILES.items()},
        "other": _("another one"),
    },
    "returning": ENDING_NAMES,
    "devices": {
        "computer": pgettext_lazy("a device", "computer"),
        "tablet": pgettext_lazy("a device", "tablet"),
        "phone": pgettext_lazy("a device", "phone"),
    },
}
