import re
import sys
from typing import get_args

import msgspec

from experiments.definition import analyses, coding, design, plan, schema, wizard
from experiments.definition.cues import CueKey
from experiments.definition.recruitment import recruiting
from experiments.definition.steps import KINDS
from experiments.tasks.progress import EventType
from surveys.documents import DocumentPart
from tests.support.paths import ROOT

EXPLAINED = set(
    re.findall(r"`([a-z_]+)`", (ROOT / "docs" / "reference" / "studies.md").read_text())
)
PARTS = [
    part
    for module in (
        schema,
        analyses,
        coding,
        design,
        wizard,
        plan,
        recruiting,
        *(sys.modules[kind.__module__] for kind in KINDS.values()),
    )
    for part in vars(module).values()
    if isinstance(part, type)
    and issubclass(part, DocumentPart)
    and part.__module__ == module.__name__
]


def test_every_field_and_kind_of_a_study_is_explained():
    fields = {field.encode_name for kind in PARTS for field in msgspec.structs.fields(kind)}
    kinds = {kind.__struct_config__.tag for kind in PARTS if kind.__struct_config__.tag}
    assert len(fields) > 50
    assert (fields | kinds) - EXPLAINED == set()


def test_every_event_and_every_cue_is_explained():
    assert {*get_args(EventType), *get_args(CueKey)} - EXPLAINED == set()
