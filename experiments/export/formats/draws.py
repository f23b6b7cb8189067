"""The assignment of participants: each draw with its inputs, so that it can be repeated."""

import json
from collections.abc import Iterator, Sequence
from typing import Any

from experiments.dataset.columns import Column, amount_of, share
from experiments.dataset.levels import KINDS
from experiments.export.format import ExportFormat, File
from experiments.models import Draw

REASONS = {
    "first": "the first assignment",
    "again": "again, because the participant had seen nothing of the first",
}
DRAWS = (
    Column("number", "", "order of the draws within a kind of participants"),
    Column("participant", "", "code of the participant; empty: not in this dataset"),
    Column("kind", "", "for whom it was drawn", levels=KINDS),
    amount_of("draw", "", "first, second … draw of the participant"),
    Column("reason", "", "why it was drawn", levels=REASONS),
    Column("cell", "", "cell that was drawn", divider="-"),
    Column("best", "", "cells with the lowest score, with | between them"),
    Column("counts", "", "JSON: places taken in each open cell before the draw"),
    Column("scores", "", "JSON: of these, those of participants alike in the balance factors"),
    Column("levels", "", "JSON: the participant's level of each balance factor; none in public"),
    share("best_probability", "probability of one of the best cells"),
    Column("seed", "", "seed of the draw"),
    Column("at", "", "when it was drawn; only in an identified dataset"),
)


class DrawsFormat(ExportFormat):
    tables = {"draws": DRAWS}

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
