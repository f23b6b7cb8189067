"""Messages with every field filled with a recognisable value. The values are derived from the types
of the fields, so new messages and fields are filled too.
"""

import inspect
import itertools
import uuid
from typing import Any

import msgspec
import numpy as np
from msgspec import inspect as types

from robots.api import messages
from sessions import protocol

MARK = "zq"  # words that were made here begin so
DIGITS = 8
LARGE = 4_000_000_001  # no count of anything real
_HEX = "0-9a-f"


def kinds() -> list[type]:
    """Every message between robot, page and server."""
    found = {
        one
        for module in (messages, protocol)
        for one in vars(module).values()
        if inspect.isclass(one) and issubclass(one, messages.Message)
    }
    bases = {messages.Message, messages.Action, protocol.Notice}
    return sorted(found - bases, key=lambda one: one.__qualname__)


def as_stored(message: Any) -> Any:
    """Return a message as a JSON column holds it."""
    return msgspec.json.decode(msgspec.json.encode(message))


class Filler:
    """Fills messages; `now` is Unix time in seconds, near to which all their times are."""

    def __init__(self, now: float, seed: int = 5) -> None:
        self._now = now
        self._rng = np.random.default_rng(seed)
        self._numbers = itertools.count(1)

    def word(self) -> str:
        """Return a unique word."""
        return f"{MARK}{next(self._numbers):0{DIGITS}x}"

    def key(self) -> str:
        return str(uuid.UUID(bytes=self._rng.bytes(16), version=4))

    def hash(self) -> str:
        return str(self._rng.bytes(32).hex())

    def time(self) -> float:
        """Return a time of the clock, in Unix seconds."""
        return self._now + next(self._numbers) / 1024

    def count(self) -> int:
        """Return a unique number."""
        return LARGE + next(self._numbers) * 7919

    def anything(self) -> dict[str, Any]:
        """Return an object with all of these, by names that programs use and by one of its own, at
        its top and deeper.
        """
        values = {
            "stamp": self.time(),
            "milliseconds": int(self.time() * 1e3),
            "nanoseconds": int(self.time() * 1e9),
            "sha256": self.hash(),
            "actionId": self.key(),
            "user": self.key(),
            "reason": self.word(),
            "name": self.word(),
            self.word(): self.word(),
        }
        return values | {"more": {**values, "list": list(values.values())}}

    def message(self, kind: type, **fixed: Any) -> Any:
        """Return a message with every field filled but those that are given.

        Raises:
            msgspec.ValidationError: it would not be taken on the wire.
        """
        info = types.type_info(kind)
        assert isinstance(info, types.StructType)
        whole = {one.name: self._value(one.type) for one in info.fields} | fixed
        return msgspec.json.decode(msgspec.json.encode(kind(**whole)), type=kind)

    def _value(self, kind: types.Type) -> Any:
        match kind:
            case types.Metadata(type=inner, extra_json_schema=about):
                is_time = str((about or {}).get("description", "")).startswith("Unix time")
                return self.time() if is_time else self._value(inner)
            case types.UnionType(types=members):
                some = [one for one in members if not isinstance(one, types.NoneType)]
                return self._value(some[0])
            case types.LiteralType(values=values):
                return values[-1]
            case types.BoolType():
                return True
            case types.IntType(ge=least, le=most):
                return self.count() if most is None or most > LARGE * 2 else int(most or least or 1)
            case types.FloatType():
                return self._measure(kind)
            case types.StrType(pattern=pattern):
                return self.hash() if pattern and _HEX in pattern else self._text(kind)
            case types.VarTupleType(item_type=item, min_length=least):
                return tuple(self._value(item) for _ in range(max(1, least or 0)))
            case types.TupleType(item_types=items):
                return tuple(self._value(item) for item in items)
            case types.DictType(value_type=item):
                return self._mapping(item)
            case types.StructType(cls=inner):
                return self.message(inner)
            case types.RawType():
                return msgspec.Raw(msgspec.json.encode(self.anything()))
        raise TypeError(f"no value for {kind}: add one here")

    @staticmethod
    def _measure(kind: types.FloatType) -> float:
        least = kind.ge if kind.ge is not None else kind.gt
        most = kind.le if kind.le is not None else kind.lt
        low, high = max(least or 0.0, 0.0), most or 1.0
        return min(low + 0.25, (low + high) / 2.0)

    def _text(self, kind: types.StrType) -> str:
        """An id is a row's, as ours are."""
        return self.key() if kind.pattern else self.word()[: kind.max_length]

    def _mapping(self, item: types.Type) -> dict[str, Any]:
        if isinstance(item, types.AnyType):
            return self.anything()
        inner = item.type if isinstance(item, types.Metadata) else item
        if isinstance(inner, types.UnionType):  # of numbers and words
            return {name: one for name, one in self.anything().items() if not isinstance(one, dict)}
        return {self.word(): self._value(item) for _ in range(2)}
