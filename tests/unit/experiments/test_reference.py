import re
from typing import get_args

import msgspec

from experiments.definition import schema
from experiments.definition.cues import CueKey
from experiments.tasks.progress import EventType
from tests.support.paths import ROOT

EXPLAINED = set(
    re.findall(r"`([a-z_]+)`", (ROOT / "docs" / "reference" / "studies.md").read_text())
)
PARTS = [
    kind
    for kind in vars(schema).values()
    if isinstance(kind, type) and issubclass(kind, schema.Part) and kind is not schema.Part
]


def test_every_field_and_kind_of_a_study_is_explained():
    fields = {field.encode_name for kind in PARTS for field in msgspec.structs.fields(kind)}
    kinds = {kind.__struct_config__.tag for kind in PARTS if kind.__struct_config__.tag}
    assert len(fields) > 50
    assert (fields | kinds) - EXPLAINED == set()


def test_every_event_and_every_cue_is_explained():
    assert {*get_args(EventType), *get_args(CueKey)} - EXPLAINED == set()
