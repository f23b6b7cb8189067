"""Which events of two coders are the same. Pure.

Of one code, events match whose beginnings lie within a tolerance, each once, in order of time. The
nearest of the rest are what the coders took for different codes; only one coder has the others.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from operator import attrgetter

from experiments.coding.scheme import CodedEvent

_begin = attrgetter("begin")


def matched(
    first: Iterable[CodedEvent], second: Iterable[CodedEvent], code: str, tolerance: float
) -> tuple[list[tuple[CodedEvent, CodedEvent]], list[CodedEvent], list[CodedEvent]]:
    """Return the events of a code that two coders have in common, those that only the first has,
    and those that only the second has: beginnings at most `tolerance` seconds apart, the earliest
    pairs first.
    """
    one, two = (
        sorted((event for event in events if event.code == code), key=_begin)
        for events in (first, second)
    )
    pairs, left, right = [], list[CodedEvent](), list[CodedEvent]()
    while one and two:
        if abs(one[0].begin - two[0].begin) <= tolerance + 1e-9:
            pairs.append((one.pop(0), two.pop(0)))
        elif one[0].begin < two[0].begin:
            left.append(one.pop(0))
        else:
            right.append(two.pop(0))
    return pairs, left + one, right + two


def aligned(
    first: Sequence[CodedEvent], second: Sequence[CodedEvent], tolerance: float
) -> list[tuple[float, str, str]]:
    """Return the events of two coders as their beginning and two codes, "" where a coder has none:
    first the matching ones of each code, then the nearest of the others, within the tolerance.
    """
    found: list[tuple[float, str, str]] = []
    left: list[CodedEvent] = []
    right: list[CodedEvent] = []
    for code in sorted({event.code for event in (*first, *second)}):
        pairs, only_first, only_second = matched(first, second, code, tolerance)
        found += [(one.begin, code, code) for one, _two in pairs]
        left += only_first
        right += only_second
    return [*found, *_confused(left, sorted(right, key=_begin), tolerance)]


def _confused(
    left: Sequence[CodedEvent], right: Sequence[CodedEvent], tolerance: float
) -> Iterator[tuple[float, str, str]]:
    """Yield events of different codes that lie near each other, then those of one coder alone;
    `right` is in order of time.
    """
    near = []
    for i, one in enumerate(left):
        first = bisect_left(right, one.begin - tolerance - 1e-9, key=_begin)
        last = bisect_right(right, one.begin + tolerance + 1e-9, key=_begin)
        near += [
            (abs(one.begin - right[j].begin), i, j)
            for j in range(first, last)
            if one.code != right[j].code
        ]
    ones, twos = dict(enumerate(left)), dict(enumerate(right))
    for _distance, i, j in sorted(near):
        if i in ones and j in twos:
            one = ones.pop(i)
            yield one.begin, one.code, twos.pop(j).code
    yield from ((one.begin, one.code, "") for one in ones.values())
    yield from ((two.begin, "", two.code) for two in twos.values())
