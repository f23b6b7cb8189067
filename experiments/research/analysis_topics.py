"""The pages of the analysis: a topic each, with the figures and tables of a report that belong to
it.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from django.utils.functional import Promise
from django.utils.translation import gettext_lazy as _


@dataclass(frozen=True)
class AnalysisTopic:
    """A page, `key` in its address. `names` are those of figures and tables in the order in which
    they are shown; one that ends in a hyphen stands for all that begin so. A topic that `is_text`
    has sentences, not numbers of sessions.
    """

    key: str
    title: str | Promise
    names: tuple[str, ...]
    is_text: bool = False

    def holds(self, name: str) -> bool:
        """Tell whether a figure or table belongs here."""
        return self._place(name) is not None

    def of(self, parts: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
        """Return the parts that belong here and say something, in order."""
        mine = [one for one in parts if self.holds(one["name"]) and not one["empty"]]
        return sorted(mine, key=lambda one: self._place(one["name"]) or 0)

    def _place(self, name: str) -> int | None:
        found = (
            at
            for at, known in enumerate(self.names)
            if name == known or (known.endswith("-") and name.startswith(known))
        )
        return next(found, None)


TOPICS = (
    AnalysisTopic("overview", _("Overview"), ("flow", "orders", "funnel", "table-1", "table-3")),
    AnalysisTopic("participants", _("Participants"), ("participants", "table-2")),
    AnalysisTopic(
        "outcomes",
        _("Outcomes"),
        (
            "outcomes",
            "fault-sides",
            "hypotheses",
            "analysis-",
            "exclusions-effect",
            "conditions",
            "learning",
            "learning-tests",
            "metrics",
        ),
    ),
    AnalysisTopic(
        "questionnaires",
        _("Questionnaires"),
        (
            "figure-8a",
            "figure-8b",
            "figure-scores-",
            "answers",
            "score-tests-",
            "scores-",
            "reliability",
            "table-5",
            "table-5-",
            "table-4",
        ),
    ),
    AnalysisTopic(
        "trajectories",
        _("Trajectories"),
        ("figure-7", "figure-6-", "segment-metrics", "segments"),
    ),
    AnalysisTopic(
        "network", _("Network"), ("ages", "safety-limits", "network-effects", "network-classes")
    ),
    AnalysisTopic(
        "reporting", _("Reporting sheet"), ("reporting-sheet", "exclusions"), is_text=True
    ),
    AnalysisTopic("data-quality", _("Data quality"), ("quality", "sessions", "software")),
)


def topic_of(name: str) -> AnalysisTopic:
    """Return the topic of a figure or table.

    Raises:
        LookupError: it belongs to none.
    """
    for topic in TOPICS:
        if topic.holds(name):
            return topic
    raise LookupError(f"{name} is on no page of the analysis")
