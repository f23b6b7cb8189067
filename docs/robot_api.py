"""Writes the reference of the Robot API, and docs/page_codec.py the shapes for pages:
`python -m docs.robot_api` from the top of the project.

The second half of docs/reference/robot-api.md and the whole of the JSON Schema come from the topic
table, the classes of the messages with their docstrings, and the golden messages in tests/golden,
which the tests of Python and JavaScript decode, too. A test compares both files with the code.
"""

import inspect
import json
import typing
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from docs import page_codec
from robots.api import messages as m, topics
from robots.api.reasons import ReasonCode

ROOT = Path(__file__).resolve().parents[1]
REFERENCE = "docs/reference/robot-api.md"
SCHEMA = "docs/reference/robot-api.schema.json"
TOPICS = (*topics.TABLE, *topics.DATA_CHANNEL_ONLY)
WITH_MESSAGES = tuple(topic for topic in TOPICS if topic.content is not bytes)
MANAGER_STATUS = "server/manager"
GENERATED = "<!-- `python -m docs.robot_api` writes the rest from the code; do not edit it. -->\n"
_RANGES = (
    ("ge", "≥ {}"),
    ("gt", "> {}"),
    ("le", "≤ {}"),
    ("lt", "< {}"),
    ("min_length", "at least {} long"),
    ("max_length", "at most {} long"),
)


@cache
def examples() -> dict[str, dict[str, m.Message]]:
    """Return suffix → name → message of the golden files.

    `least` has only the required fields, and the other examples of a topic together have all.
    """
    contents = {
        **{topic.suffix: topic.content for topic in WITH_MESSAGES},
        MANAGER_STATUS: m.ManagerStatus,
    }
    return {
        suffix: {
            name: msgspec.convert(message, content)
            for name, message in json.loads(golden_path(suffix).read_text("utf-8"))[
                "messages"
            ].items()
        }
        for suffix, content in contents.items()
    }


def golden_path(suffix: str) -> Path:
    """Return the file with the golden messages of a topic."""
    return ROOT / "tests/golden" / (suffix.replace("/+", "").replace("/", "-") + ".json")


def as_json(value: object) -> str:
    """Return the text of a JSON file."""
    return json.dumps(value, indent=2, ensure_ascii=False) + "\n"


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema, with a definition for each message, and the messages of each suffix
    under `topics`.
    """
    kinds = [*(topic.content for topic in WITH_MESSAGES), m.ManagerStatus]
    shapes, definitions = msgspec.json.schema_components(kinds, ref_template="#/$defs/{name}")
    for definition in definitions.values():
        if "description" in definition:
            definition["description"] = " ".join(definition["description"].split())
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"Robot API, version {m.VERSION}",
        "description": "Payloads by topic suffix; + stands for one word. Photos and pictures are"
        " bytes, not JSON, and therefore not here.",
        "topics": {
            topic.suffix: shape for topic, shape in zip(WITH_MESSAGES, shapes, strict=False)
        },
        "$defs": dict(sorted(definitions.items())),
    }


def reference() -> str:
    """Return the reference: the part that is written by hand, then the generated one."""
    parts = [_topic_table(), "## Messages\n", *map(_topic_section, TOPICS)]
    parts += ["## Parts\n", *(_class_section(kind, "###") for kind in _parts())]
    parts += ["## Between servers\n", _class_section(m.ManagerStatus, "###")]
    parts += [*_examples(MANAGER_STATUS), _reasons()]
    by_hand = (ROOT / REFERENCE).read_text("utf-8").partition(GENERATED)[0]
    return by_hand + GENERATED + "\n" + "\n".join(parts).rstrip() + "\n"


def generated_files() -> dict[str, str]:
    """Return path → text of each generated file."""
    return {REFERENCE: reference(), SCHEMA: as_json(json_schema()), **page_codec.files()}


def classes(content: object) -> list[type[m.Message]]:
    """Return the message classes that a topic carries."""
    return [
        kind
        for kind in typing.get_args(content) or (content,)
        if inspect.isclass(kind) and issubclass(kind, m.Message)
    ]


def _topic_table() -> str:
    rows = [
        "## Topics\n",
        "| suffix | direction | QoS | retained | at most | content |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for topic in TOPICS:
        transport = f"{topic.qos} | {'yes' if topic.retained else 'no'}"
        direction = "robot →" if topic.direction == "from_robot" else "→ robot"
        if topic in topics.DATA_CHANNEL_ONLY:
            direction, transport = "robot → page, data channel only", "|"
        rows.append(
            f"| `{topic.suffix}` | {direction} | {transport} | {topic.limit // topics.KIB} KiB |"
            f" {topic.doc} |"
        )
    return "\n".join(rows) + "\n"


def _reasons() -> str:
    rows = (f"| `{code}` | {code.clause_in(str) or code.sentence} |" for code in ReasonCode)
    head = "`{what}` is the value. A code without a text is counted or recorded."
    return "\n".join(["## Reasons\n", head, "\n| code | text |", "| --- | --- |", *rows, ""])


def _topic_section(topic: topics.Topic) -> str:
    head = f"### `{topic.suffix}`\n\n{topic.doc[0].upper()}{topic.doc[1:]}.\n"
    if topic.content is bytes:
        return head + "\nBytes, no JSON.\n"
    sections = [_class_section(kind, "####") for kind in classes(topic.content)]
    return "\n".join([head, *sections, *_examples(topic.suffix)])


def _examples(suffix: str) -> list[str]:
    return [
        f"Example, {name}:\n\n```json\n{as_json(msgspec.to_builtins(message))}```\n"
        for name, message in examples()[suffix].items()
    ]


def _class_section(kind: type[m.Message], heading: str) -> str:
    lines = [
        f"{heading} {kind.__name__}\n",
        inspect.cleandoc(kind.__doc__ or "") + "\n",
        "| field | type | when left out |",
        "| --- | --- | --- |",
    ]
    if tag := kind.__struct_config__.tag:
        lines.append(f'| `{kind.__struct_config__.tag_field}` | `"{tag}"` | required |')
    lines += [_field_row(field) for field in msgspec.structs.fields(kind)]
    return "\n".join(lines) + "\n"


def _field_row(field: msgspec.structs.FieldInfo) -> str:
    default = "required" if field.required else f"`{json.dumps(_default(field))}`"
    return f"| `{field.encode_name}` | {_type_words(field.type)} | {default} |"


def _default(field: msgspec.structs.FieldInfo) -> object:
    made = field.default_factory() if callable(field.default_factory) else field.default
    return msgspec.to_builtins(made)


def _type_words(kind: object) -> str:
    """Return a type as a reader of the table wants it: its name, and its range in words."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return _type_words(arguments[0]) + _range_words(arguments[1])
    if origin is typing.Literal:
        return " \\| ".join(f'`"{word}"`' for word in arguments)
    if origin is tuple:
        many = len(arguments) == 2 and arguments[1] is Ellipsis
        return (
            f"list of {_type_words(arguments[0])}"
            if many
            else f"[{', '.join(_type_words(argument) for argument in arguments)}]"
        )
    if origin is dict:
        return f"object of {_type_words(arguments[1])}"
    if arguments:
        return " or ".join(_type_words(argument) for argument in arguments)
    names = {
        typing.Any: "anything",
        type(None): "null",
        float: "number",
        int: "integer",
        str: "string",
        bool: "true or false",
    }
    return names.get(
        typing.cast("type", kind),
        f"[{getattr(kind, '__name__', kind)}](#{getattr(kind, '__name__', '').lower()})",
    )


def _range_words(meta: msgspec.Meta) -> str:
    words = [
        text.format(_number(value))
        for name, text in _RANGES
        if (value := getattr(meta, name)) is not None
    ]
    if meta.pattern is not None:
        words.append(f"`{meta.pattern}`")
    return f" ({', '.join(words)})" if words else ""


def _number(value: float) -> str:
    return f"{value:,}" if isinstance(value, int) else f"{value:g}"


def _parts() -> list[type[m.Message]]:
    """Return the classes that are fields of messages and no message of a topic themselves, in the
    order of the module.
    """
    others = {m.Message, m.Action, m.ManagerStatus}.union(
        *(classes(topic.content) for topic in TOPICS)
    )
    return [kind for value in vars(m).values() for kind in classes(value) if kind not in others]


if __name__ == "__main__":
    for name, text in generated_files().items():
        (ROOT / name).write_text(text, encoding="utf-8")
