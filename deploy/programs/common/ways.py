"""Other ways to do what no public source shows: the ladder tries them where a rung fails, and --ways asks for them.

None was tried on hardware. This needs nothing but Python.
"""

from itertools import combinations
from typing import FrozenSet, List, NamedTuple, Sequence, Tuple

from refusals import Refused


class OtherWay(NamedTuple):
    """One way: its name, what it is another way to do, what it does, and the rungs whose failure it may cure."""

    name: str
    instead: str
    does: str
    cures: Tuple[str, ...]


def chosen(words: str, ways: Sequence[OtherWay]) -> FrozenSet[str]:
    """The ways that are named in ``words``, with commas between them.

    Raises:
        Refused: there is no such way, or two are for one thing.
    """
    names = frozenset(word.strip() for word in words.split(",") if word.strip())
    known = {way.name: way.instead for way in ways}
    for name in sorted(names - set(known)):
        raise Refused("input", "there is no way {}; --ways knows {}".format(name, ", ".join(known)))
    if len({known[name] for name in names}) < len(names):
        raise Refused("input", "--ways names two ways to do the same; keep one of them")
    return names


def tries(ways: Sequence[OtherWay], rung: str, taken: FrozenSet[str]) -> List[FrozenSet[str]]:
    """What to try for a rung, beside the ways that are ``taken``: nothing more, then each way, then two of them."""
    done = {way.instead for way in ways if way.name in taken}
    able = [way for way in ways if rung in way.cures and way.instead not in done]
    pairs = [pair for pair in combinations(able, 2) if pair[0].instead != pair[1].instead]
    return [frozenset()] + [frozenset(way.name for way in few) for few in [(way,) for way in able] + pairs]
