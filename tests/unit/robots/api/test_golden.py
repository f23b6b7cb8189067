"""The golden messages, which Python and JavaScript (tests/js/protocol/robot_api.test.js) decode."""

import inspect
import json

import msgspec
import pytest

from docs.robot_api import MANAGER_STATUS, WITH_MESSAGES, as_json, examples, golden_path
from robots.api import codec, messages
from robots.api.errors import Rejection
from sessions import protocol
from tests.support.paths import GOLDEN

REFUSED = json.loads((GOLDEN / "refused.json").read_text(encoding="utf-8"))
WIRE = json.loads((GOLDEN / "wire.json").read_text(encoding="utf-8"))
SUFFIXES = [topic.suffix for topic in WITH_MESSAGES]


@pytest.mark.parametrize(
    ("suffix", "name"), [(suffix, name) for suffix in SUFFIXES for name in examples()[suffix]]
)
def test_a_golden_message_is_decoded_and_encoded_unchanged(suffix, name):
    golden = json.loads(golden_path(suffix).read_text("utf-8"))["messages"][name]
    message = codec.decode(suffix.replace("+", "p1"), json.dumps(golden))
    assert message == examples()[suffix][name]
    assert json.loads(codec.encode(message)) == golden


@pytest.mark.parametrize("suffix", [*SUFFIXES, MANAGER_STATUS])
def test_a_golden_file_has_its_suffix_and_its_messages_as_python_writes_them(suffix):
    written = {"suffix": suffix, "messages": msgspec.to_builtins(examples()[suffix])}
    assert golden_path(suffix).read_text("utf-8") == as_json(written)


def test_every_message_class_has_a_golden_message():
    shown = [message for named in examples().values() for message in named.values()]
    inside = {type(value) for message in shown for value in parts(message)}
    every = {
        kind
        for _, kind in inspect.getmembers(messages, inspect.isclass)
        if issubclass(kind, messages.Message)
    }
    assert every - {messages.Message, messages.Action} <= {*map(type, shown)} | inside


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
def test_messages_to_the_page_are_written_as_in_the_golden_file(suffix, name):
    golden = WIRE["toPage"][suffix][name]
    message = msgspec.json.decode(json.dumps(golden), type=protocol.TO_PAGE[suffix])
    assert json.loads(protocol.encode_frame(suffix, message).partition("\n")[2]) == golden


@pytest.mark.parametrize(
    ("suffix", "name"),
    [(suffix, name) for suffix, examples in WIRE["toServer"].items() for name in examples],
)
def test_messages_of_the_page_are_read_as_in_the_golden_file(suffix, name):
    golden = WIRE["toServer"][suffix][name]
    assert msgspec.to_builtins(protocol.decode(suffix, json.dumps(golden))) == golden


def test_every_word_of_the_websocket_stands_in_the_golden_file():
    assert set(WIRE["toPage"]) == set(protocol.TO_PAGE)
    assert set(WIRE["toServer"]) == {*protocol.TO_SERVER, protocol.SIGNAL}
