"""The agreement of coders, as rows of texts for a page."""

from typing import Any

from django.utils.formats import number_format
from django.utils.translation import gettext as _

from experiments.coding import store
from experiments.coding.agreement import ReliabilityEstimate
from experiments.coding.study_agreement import StudyAgreement
from experiments.models import CodingSchemeVersion


def shown(agreement: StudyAgreement, scheme: CodingSchemeVersion) -> dict[str, Any]:
    names = {code.code: code.name for code in store.read_scheme(scheme).codes}
    names[""] = _("All codes together")
    coders = [f"C{number}" for number in agreement.coders]
    return {
        "sessions": agreement.sessions,
        "waiting": agreement.waiting,
        "codes": [
            {
                "name": names[one.code],
                "bins": one.bins,
                "alpha": _estimate(one.alpha),
                "pairs": [
                    {
                        "coders": " – ".join(coders[place] for place in pair.coders),
                        "agreement": _estimate(pair.agreement, percent=True),
                        "kappa": _estimate(pair.kappa),
                        "matches": pair.matches,
                    }
                    for pair in one.pairs
                ],
            }
            for one in agreement.found.codes
        ],
        "events": [
            {
                "first": coders[pair.coders[0]],
                "second": coders[pair.coders[1]],
                "kappa": _estimate(pair.kappa),
                "labels": (labels := [*(names[label] for label in pair.labels), _("nothing")]),
                "rows": list(zip(labels, pair.table.astype(int).tolist(), strict=True)),
            }
            for pair in agreement.found.events
        ],
    }


def _estimate(one: ReliabilityEstimate, *, percent: bool = False) -> str:
    """Return a figure with its interval, "–" where it is not defined."""
    if one.value is None:
        return "–"
    scale, decimals, unit = (100.0, 0, " %") if percent else (1.0, 2, "")
    value, *interval = (
        number_format(round(number * scale, decimals) + 0.0, decimals)  # no minus zero
        for number in (one.value, one.low, one.high)
        if number is not None
    )
    return f"{value}{unit} [{interval[0]}; {interval[1]}]" if len(interval) == 2 else value + unit
