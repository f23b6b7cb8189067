import json

import jsonschema
import pytest

from docs.robot_api import SCHEMA as SCHEMA_FILE, WITH_MESSAGES, examples
from robots.api.codec import encode
from tests.support.paths import ROOT

SCHEMA = json.loads((ROOT / SCHEMA_FILE).read_text("utf-8"))
EXAMPLES = {topic.suffix: examples()[topic.suffix] for topic in WITH_MESSAGES}


def validator(suffix):
    return jsonschema.Draft202012Validator({**SCHEMA, **SCHEMA["topics"][suffix]})


def test_the_schema_is_a_valid_schema_and_names_every_topic():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert set(SCHEMA["topics"]) == set(EXAMPLES)


@pytest.mark.parametrize(
    ("suffix", "name"),
    [(suffix, name) for suffix, examples in EXAMPLES.items() for name in examples],
)
def test_every_golden_message_is_valid_by_the_schema(suffix, name):
    validator(suffix).validate(json.loads(encode(EXAMPLES[suffix][name])))


@pytest.mark.parametrize(
    ("suffix", "change"),
    [
        ("state", {"seq": -1}),
        ("pose", {"stamp": "now"}),
        ("command/velocity", {"linear": 11.0}),
        ("command/action", {"type": "fly"}),
        ("lease", {"ttl": 0}),
    ],
)
def test_a_message_out_of_its_range_is_invalid_by_the_schema(suffix, change):
    message = json.loads(encode(next(iter(EXAMPLES[suffix].values())))) | change
    assert not validator(suffix).is_valid(message)
