"""Which events of two coders are the same.

Events of one code match if their beginnings are within a tolerance, each once, in order of time.
The nearest of the rest are the same event with different codes; the others have one coder alone.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from operator import attrgetter

from experiments.coding.scheme import CodedEvent

_begin = attrgetter("begin")


def matched(
    first: Iterable[CodedEvent], second: Iterable[CodedEvent], code: str, tolerance: float
) -> tuple[list[tuple[CodedEvent, CodedEvent]], list[CodedEvent], list[CodedEvent]]:
    """Return the pairs of events of a code whose beginnings are at most `tolerance` seconds apart,
    the earliest first; then the events of the first coder alone, and those of the second alone.
    """
    one = sorted((event for event in first if event.code == code), key=_begin)
    two = sorted((event for event in second if event.code == code), key=_begin)
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
    found, left, right = list[tuple[float, str, str]](), list[CodedEvent](), list[CodedEvent]()
    for code in sorted({event.code for event in (*first, *second)}):
        pairs, only_first, only_second = matched(first, second, code, tolerance)
        found += [(one.begin, code, code) for one, _two in pairs]
        left += only_first
        right += only_second
    return [*found, *_confused(left, sorted(right, key=_begin), tolerance)]


def _confused(
    left: Sequence[CodedEvent], right: Sequence[CodedEvent], tolerance: float
) -> Iterator[tuple[float, str, str]]:
    """Yield near events of different codes, then those of one coder alone; `right` is sorted."""
    near = []
    for i, one in enumerate(left):
        first = bisect_left(right, one.begin - tolerance - 1e-9, key=_begin)
        last = bisect_right(right, one.begin + tolerance + 1e-9, key=_begin)
        others = (j for j in range(first, last) if one.code != right[j].code)
        near += [(abs(one.begin - right[j].begin), i, j) for j in others]
    ones, twos = dict(enumerate(left)), dict(enumerate(right))
    for _distance, i, j in sorted(near):
        if i in ones and j in twos:
            one = ones.pop(i)
            yield one.begin, one.code, twos.pop(j).code
    yield from ((one.begin, one.code, "") for one in ones.values())
    yield from ((two.begin, "", two.code) for two in twos.values())
