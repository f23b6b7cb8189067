import json

import jsonschema
import pytest

from robots.api import topics
from robots.api.codec import encode
from robots.api.examples import EXAMPLES
from robots.api.schema import json_schema

SCHEMA = json_schema()


def validator(suffix):
    return jsonschema.Draft202012Validator({**SCHEMA, **SCHEMA["topics"][suffix]})


def test_the_schema_is_a_valid_schema_and_names_every_topic():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert set(SCHEMA["topics"]) == {
        t.suffix for t in (*topics.TABLE, *topics.DATA_CHANNEL_ONLY) if t.content is not bytes
    }


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
