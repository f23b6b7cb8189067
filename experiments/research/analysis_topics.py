"""The pages of the analysis: a topic each, with the figures and tables of a report on it."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from django.utils.functional import Promise
from django.utils.translation import gettext_lazy as _


@dataclass(frozen=True)
class AnalysisTopic:
    """A page, `key` in its address. `names` are those of figures and tables, with spaces between
    them, in the order in which they are shown; one that ends in a hyphen is a prefix. A topic that
    `is_text` has sentences, not numbers of sessions.
    """

    key: str
    title: str | Promise
    names: str
    is_text: bool = False

    def of(self, parts: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
        """Return the parts that belong here and are not empty, in order."""
        placed = [(self.place_of(one["name"]), one) for one in parts if not one["empty"]]
        mine = [(place, one) for place, one in placed if place is not None]
        return [one for _place, one in sorted(mine, key=lambda pair: pair[0])]

    def place_of(self, name: str) -> int | None:
        for place, known in enumerate(self.names.split()):
            if name == known or (known.endswith("-") and name.startswith(known)):
                return place
        return None


TOPICS = (
    AnalysisTopic("overview", _("Overview"), "flow orders funnel table-1 table-3"),
    AnalysisTopic("participants", _("Participants"), "participants table-2"),
    AnalysisTopic(
        "outcomes",
        _("Outcomes"),
        "outcomes fault-sides hypotheses analysis- exclusions-effect success-sensitivity "
        "conditions learning learning-tests metrics",
    ),
    AnalysisTopic(
        "questionnaires",
        _("Questionnaires"),
        "figure-8a figure-8b figure-scores- answers score-tests- scores- reliability table-5 "
        "table-5- table-4",
    ),
    AnalysisTopic("trajectories", _("Trajectories"), "figure-7 figure-6- segment-metrics segments"),
    AnalysisTopic("network", _("Network"), "ages safety-limits network-effects network-classes"),
    AnalysisTopic("reporting", _("Reporting sheet"), "reporting-sheet exclusions", is_text=True),
    AnalysisTopic("data-quality", _("Data quality"), "quality sessions software"),
)


def topic_of(name: str) -> AnalysisTopic:
    """Return the topic of a figure or table; a LookupError when it belongs to none."""
    for topic in TOPICS:
        if topic.place_of(name) is not None:
            return topic
    raise LookupError(f"{name} is on no page of the analysis")
