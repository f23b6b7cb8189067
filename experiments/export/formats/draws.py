"""The assignment of participants: each draw with its inputs, so that it can be repeated."""

import json
from collections.abc import Iterator, Sequence
from typing import Any

from experiments.dataset.levels import KINDS
from experiments.export.format import ExportFormat, File, listed_columns
from experiments.models import Draw


class DrawsFormat(ExportFormat):
    tables = {"draws": listed_columns("draws", kind=KINDS)}

    def of_study(self) -> Iterator[File]:
        about = self.source.dataset.study
        draws = Draw.objects.filter(study__slug=about.slug, study__version=about.version)
        ordered = draws.select_related("participant").order_by("kind", "number")
        there = {one.id for one in self.source.dataset.participants}
        yield self.source.table("draws", (self._row(one, there) for one in ordered))

    def _row(self, draw: Draw, there: set[str]) -> Sequence[Any]:
        choice, code = self.source.release.choice, draw.participant.code
        levels = {} if choice.public else draw.levels
        return (
            *(draw.number, code if code in there else "", draw.kind, draw.nth),
            *(draw.reason, draw.cell, "|".join(draw.best)),
            *map(json.dumps, (draw.counts, draw.scores, levels)),
            *(draw.best_probability, draw.seed),
            draw.at.isoformat() if draw.at is not None and choice.identified else "",
        )
