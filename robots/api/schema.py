"""The JSON Schema of Robot API v1: what a writer of an agent in another language
validates against.
"""

from typing import Any, cast

import msgspec

from robots.api import messages, topics

DIALECT = "https://json-schema.org/draft/2020-12/schema"
DESCRIPTION = (
    "Payloads by topic suffix; + stands for one word. Photos and pictures are bytes, not JSON, and"
    " therefore not here."
)


def json_schema() -> dict[str, Any]:
    """Return the whole schema: a definition a message, and under `topics` the one that each suffix
    carries.
    """
    lines = [
        topic for topic in (*topics.TABLE, *topics.DATA_CHANNEL_ONLY) if topic.content is not bytes
    ]
    kinds = [*(topic.content for topic in lines), messages.ManagerStatus]
    shapes, definitions = msgspec.json.schema_components(kinds, ref_template="#/$defs/{name}")
    return {
        "$schema": DIALECT,
        "title": f"Robot API, version {messages.VERSION}",
        "description": DESCRIPTION,
        "topics": {
            topic.suffix: _plain(shape) for topic, shape in zip(lines, shapes, strict=False)
        },
        "$defs": dict(sorted((name, _plain(shape)) for name, shape in definitions.items())),
    }


def _plain(shape: Any) -> Any:
    """Return the shape as JSON itself would give it back: tuples as lists, and docstrings on one
    line where they were wrapped.
    """
    built = cast("dict[str, Any]", msgspec.to_builtins(shape))
    if "description" in built:
        built["description"] = " ".join(built["description"].split())
    return built
