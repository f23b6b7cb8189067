"""Writes what the codec of the pages knows of the messages (`make docs`): the shapes that it reads,
static/js/protocol/messages.js, and their TypeScript types, messages.d.ts beside it. Both follow
from the JSON Schema of the classes in robots/api/messages.py and sessions/protocol.py.
"""

import json
import math
import textwrap
import typing
from typing import Any

import msgspec

from robots.api import messages, topics
from robots.api.reasons import ReasonCode
from sessions import protocol

Schema = dict[str, Any]

SCRIPT = "static/js/protocol/messages.js"
TYPES = "static/js/protocol/messages.d.ts"
HEAD = "// Generated from robots/api and sessions/protocol.py by `make docs`; do not edit.\n\n"
IMPORT = """import {
  absent, dictionary, flag, integer, list, matching, nullable, number, object, oneOf, optional,
  scalar, tagged, text, tuple,
} from "./shapes.js";

"""
# What a robot sends to the pages concerned, besides what it sends to all of them.
TO_SOME = ("factsheet", "words", "receipt", "pointer")
ON_DATA_CHANNEL = (*topics.TO_PAGE, "pointer")
LONGEST = 128 * topics.KIB  # bytes of a message of the server: of `signal/reply`, the longest
_SIMPLE = {"integer": "number", "number": "number", "string": "string", "boolean": "boolean"}


def files() -> dict[str, str]:
    """Return path → text of both files."""
    every = (*topics.TABLE, *topics.DATA_CHANNEL_ONLY)
    of_robot = {t.suffix: t for t in every if t.suffix in {*topics.TO_PAGE, *TO_SOME}}
    contents = {suffix: topic.content for suffix, topic in of_robot.items()} | protocol.TO_PAGE
    schemas, parts = msgspec.json.schema_components(contents.values(), ref_template="{name}")
    to_page = dict(zip(contents, schemas, strict=True))
    limits = {suffix: topic.limit for suffix, topic in of_robot.items()}
    return {SCRIPT: _script(to_page, parts, limits), TYPES: _types(to_page, parts)}


def _script(to_page: dict[str, Schema], parts: dict[str, Schema], limits: dict[str, int]) -> str:
    writer = _ShapeWriter(parts)
    entries = [
        f"{json.dumps(suffix)}: [{limits.get(suffix, LONGEST)}, {writer.shape(schema)}],"
        for suffix, schema in to_page.items()
    ]
    constants = [_wrapped(f"const {name} = {shape};") for name, shape in writer.constants.items()]
    to_page_lines = ["\nexport const TO_PAGE = {", *(_wrapped(one, "  ") for one in entries), "};"]
    channel = _wrapped(f"export const ON_DATA_CHANNEL = new Set({json.dumps(ON_DATA_CHANNEL)});")
    codes = [code for code in ReasonCode if code.sentence]
    reasons = _wrapped(f"export const REASONS = new Set({json.dumps(codes)});")
    return HEAD + IMPORT + "\n".join([*constants, *to_page_lines, "", channel, "", reasons, ""])


def _wrapped(line: str, indent: str = "") -> str:
    """Return code on lines of at most 100 columns; a field stays beside its shape."""
    wrapper = textwrap.TextWrapper(100, break_long_words=False, break_on_hyphens=False)
    wrapper.initial_indent, wrapper.subsequent_indent = indent, indent + "  "
    return wrapper.fill(line.replace(": ", ":\0")).replace("\0", " ")


class _ShapeWriter:
    """Writes schemas as calls of static/js/protocol/shapes.js. `constants` has what it has named so
    far: the parts of messages, and the types that have a name in Python.
    """

    def __init__(self, parts: dict[str, Schema]) -> None:
        self.constants: dict[str, str] = {}
        self._parts = parts
        self._names = {
            _key(msgspec.json.schema(kind)): name[0].lower() + name[1:]
            for name, kind in (vars(messages) | vars(protocol)).items()
            if typing.get_origin(kind) in {typing.Annotated, typing.Literal, tuple}
        }

    def shape(self, schema: Schema) -> str:
        """Return an expression for what a schema describes, a name if it has one."""
        name = schema.get("$ref") or self._names.get(_key(schema))
        if name is None:
            return self._built(schema)
        if name not in self.constants:
            self.constants[name] = self._built(self._parts.get(name, schema))
        return str(name)

    def _built(self, schema: Schema) -> str:
        match schema:
            case {"discriminator": {"propertyName": tag, "mapping": mapping}}:
                kinds = (f"{kind}: {self.shape({'$ref': of})}" for kind, of in mapping.items())
                return f"tagged({json.dumps(tag)}, {{ {', '.join(kinds)} }})"
            case {"anyOf": [one, {"type": "null"}]}:
                return f"nullable({self.shape(one)})"
            case {"prefixItems": items}:
                return f"tuple({', '.join(map(self.shape, items))})"
            case {"items": item}:
                longest, shortest = schema.get("maxItems", "Infinity"), schema.get("minItems")
                return _called("list", self.shape(item), longest, shortest)
            case {"properties": properties}:
                fields = ((name, self._field(one)) for name, one in properties.items())
                texts = (name if name == shape else f"{name}: {shape}" for name, shape in fields)
                return f"object({{ {', '.join(texts)} }})"
            case {"additionalProperties": value}:
                return _called("dictionary", self.shape(value), schema["maxProperties"])
            case _:
                return _scalar(schema)

    def _field(self, schema: Schema) -> str:
        if "default" not in schema:
            return self.shape(schema)
        default = schema["default"]
        if default is None:
            return f"absent({self.shape(schema['anyOf'][0])})"
        bare = {key: value for key, value in schema.items() if key != "default"}
        return f"optional({self.shape(bare)}, {_number(default)})"


def _scalar(schema: Schema) -> str:
    match schema:
        case {"anyOf": _}:
            return "scalar"
        case {"enum": words}:
            return f"oneOf({', '.join(map(json.dumps, words))})"
        case {"pattern": pattern}:
            return f"matching(/{pattern}/)"
        case {"type": "string"}:
            return _called("text", schema["maxLength"], schema.get("minLength"))
        case {"type": "boolean"}:
            return "flag"
        case _:
            return f"{schema['type']}({', '.join(map(_number, _range(schema)))})"


def _key(schema: Schema) -> str:
    return json.dumps({key: schema[key] for key in schema if key not in {"default", "description"}})


def _called(name: str, *arguments: object) -> str:
    return f"{name}({', '.join(str(one) for one in arguments if one is not None)})"


def _range(schema: Schema) -> tuple[float, float]:
    """Return the least and the largest number of a range, which may be open."""
    low, high = schema.get("exclusiveMinimum"), schema.get("exclusiveMaximum")
    return (
        schema["minimum"] if low is None else math.nextafter(low, math.inf),
        schema["maximum"] if high is None else math.nextafter(high, -math.inf),
    )


def _number(value: Any) -> str:
    """Return a value in JavaScript, a number as short as it can be."""
    if not isinstance(value, float):
        return json.dumps(value)
    return min((text for text in (repr(value), f"{value:g}") if float(text) == value), key=len)


def _types(to_page: dict[str, Schema], parts: dict[str, Schema]) -> str:
    lines = [
        *(_wrapped(f"export interface {name} {_type(part)}") for name, part in parts.items()),
        "\n/** By suffix. */",
        _wrapped(f"export interface ToPage {_type({'properties': to_page})}") + "\n",
        "/** The largest size in bytes, and the shape, of the messages that a page receives. */",
        'export const TO_PAGE: Record<string, [number, import("./shapes.js").Shape]>;',
        "/** The suffixes that a robot's data channel may carry to a page. */",
        "export const ON_DATA_CHANNEL: Set<string>;",
        "/** The codes for which the page has the sentence `reason.<code>`. */",
        "export const REASONS: Set<string>;\n",
    ]
    return HEAD + "\n".join(lines)


def _type(schema: Schema) -> str:
    """Return the TypeScript type of what a schema describes, with its defaults filled in."""
    match schema:
        case {"$ref": name}:
            return str(name)
        case {"anyOf": options}:
            return " | ".join(map(_type, options))
        case {"enum": words}:
            return " | ".join(map(json.dumps, words))
        case {"prefixItems": items}:
            return f"[{', '.join(map(_type, items))}]"
        case {"items": item}:
            return f"Array<{_type(item)}>"
        case {"properties": properties}:
            fields = (
                f"{name if name.isidentifier() else json.dumps(name)}: {_type(one)}"
                for name, one in properties.items()
            )
            return f"{{ {'; '.join(fields)} }}"
        case {"additionalProperties": value}:
            return f"Record<string, {_type(value)}>"
        case _:
            return _SIMPLE.get(schema["type"], "null")
