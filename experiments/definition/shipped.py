"""The studies that come with the site: the paper's, and its task alone and with assistance."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from experiments.definition.problems import parse
from experiments.definition.schema import StudyDefinition

SHIPPED = Path(__file__).resolve().parents[1] / "definitions"


@cache
def shipped() -> Mapping[str, StudyDefinition]:
    studies = [parse(path.read_bytes()) for path in sorted(SHIPPED.glob("*.json"))]
    return {study.slug: study for study in studies}
