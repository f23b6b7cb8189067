"""The golden messages: what Python writes, JavaScript reads (tests/js/protocol/robot_api.test.js),
and the other way round.
"""

import inspect
import json

import msgspec
import pytest

from robots.api import codec, messages, topics
from robots.api.errors import Rejection
from robots.api.examples import EXAMPLES, MANAGER_STATUS
from robots.api.reference import golden_files
from sessions import protocol
from tests.support.paths import GOLDEN

REFUSED = json.loads((GOLDEN / "refused.json").read_text(encoding="utf-8"))
WIRE = json.loads((GOLDEN / "wire.json").read_text(encoding="utf-8"))
CASES = [(suffix, name) for suffix, examples in EXAMPLES.items() for name in examples]


def concrete(suffix):
    return suffix.replace("+", "p1")


@pytest.mark.parametrize(("suffix", "name"), CASES)
def test_a_message_comes_back_from_the_wire_as_it_went(suffix, name):
    message = EXAMPLES[suffix][name]
    assert codec.decode(concrete(suffix), codec.encode(message)) == message


@pytest.mark.parametrize("name", sorted(golden_files()))
def test_a_golden_file_is_what_python_writes(name):
    assert (GOLDEN / name).read_text(encoding="utf-8") == golden_files()[name], (
        "run python -m robots.api.reference"
    )


@pytest.mark.parametrize(("suffix", "name"), CASES)
def test_a_golden_message_read_from_its_file_is_the_example(suffix, name):
    file = json.loads(
        (GOLDEN / (suffix.replace("/+", "").replace("/", "-") + ".json")).read_text(
            encoding="utf-8"
        )
    )
    assert (
        codec.decode(concrete(file["suffix"]), json.dumps(file["messages"][name]))
        == EXAMPLES[suffix][name]
    )


def test_every_topic_and_every_message_class_has_an_example():
    lines = [*topics.TABLE, *topics.DATA_CHANNEL_ONLY]
    assert {line.suffix for line in lines if line.content is not bytes} == set(EXAMPLES)
    shown = {
        type(message)
        for examples in (*EXAMPLES.values(), MANAGER_STATUS)
        for message in examples.values()
    }
    inside = {type(value) for message in all_examples() for value in parts(message)}
    every = {
        kind
        for _, kind in inspect.getmembers(messages, inspect.isclass)
        if issubclass(kind, messages.Message)
    }
    assert every - {messages.Message, messages.Action} <= shown | inside


def all_examples():
    return [
        message
        for examples in [*EXAMPLES.values(), MANAGER_STATUS]
        for message in examples.values()
    ]


def parts(value):
    if isinstance(value, messages.Message):
        for name in value.__struct_fields__:
            field = getattr(value, name)
            yield from [field, *parts(field)]
    elif isinstance(value, tuple):
        for field in value:
            yield from [field, *parts(field)]


@pytest.mark.parametrize("case", REFUSED, ids=lambda case: case["why"])
def test_a_message_that_must_be_refused_is_refused(case):
    with pytest.raises(Rejection) as refusal:
        codec.decode(case["suffix"], case["payload"])
    assert refusal.value.args[0].startswith(case["reason"])


@pytest.mark.parametrize(
    ("suffix", "name"),
    [(suffix, name) for suffix, examples in WIRE["toPage"].items() for name in examples],
)
def test_a_word_for_the_page_is_what_the_server_writes(suffix, name):
    golden = WIRE["toPage"][suffix][name]
    message = msgspec.json.decode(json.dumps(golden), type=protocol.TO_PAGE[suffix])
    assert json.loads(protocol.encode_frame(suffix, message).partition("\n")[2]) == golden


@pytest.mark.parametrize(
    ("suffix", "name"),
    [(suffix, name) for suffix, examples in WIRE["toServer"].items() for name in examples],
)
def test_a_word_of_the_page_is_what_the_server_reads(suffix, name):
    golden = WIRE["toServer"][suffix][name]
    assert msgspec.to_builtins(protocol.decode(suffix, json.dumps(golden))) == golden


def test_every_word_of_the_websocket_stands_in_the_golden_file():
    assert set(WIRE["toPage"]) == set(protocol.TO_PAGE)
    assert set(WIRE["toServer"]) == {*protocol.TO_SERVER, protocol.SIGNAL}
