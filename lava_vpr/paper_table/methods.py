"""The rows of the table: the paper's six methods, and those of this package beside them."""

from __future__ import annotations

from dataclasses import dataclass

from lava_vpr.errors import ConfigError
from lava_vpr.rows.registry import Registry

DESCRIPTORS = "descriptors"
"""What a method belongs to that compares vectors of another program: no network is learned for it."""


@dataclass(frozen=True)
class Method:
    """A row of the table.

    Attributes:
        name: Its name in files.
        title: What tables call it.
        network: The preset that is learned for it, or `DESCRIPTORS`; its baselines come with that, on the same images.
        matcher: The decoder or baseline that answers.
    """

    name: str
    title: str
    network: str
    matcher: str


METHODS: Registry[Method] = Registry("method", ConfigError)
"""The methods by name, in the order of the table: the paper's columns first."""
for _method in (
    Method("standard", "standard", "paper", "standard"),
    Method("weighted", "weighted", "paper", "weighted"),
    Method("probability", "probability", "paper", "probability"),
    Method("weighted_probability", "weighted probability", "paper", "weighted_probability"),
    Method("netvlad", "NetVLAD", DESCRIPTORS, "descriptors"),
    Method("sad", "SAD", "loihi", "sad"),
    Method("loihi", "preset loihi", "loihi", "contrast"),
    Method("fast", "preset fast", "fast", "contrast"),
    Method("template", "loihi without learning", "loihi", "template"),
    Method("cosine", "cosine of inputs", "loihi", "cosine"),
    Method("hog", "HOG", "loihi", "hog"),
):
    METHODS.register(_method)

NETWORKS = ("loihi", "fast", DESCRIPTORS, "paper")
"""What is learned, the quick ones first: a minute of all sections of Nordland, then half an hour."""


def of_network(network: str) -> tuple[Method, ...]:
    """The methods that belong to a network."""
    return tuple(method for method in METHODS.values() if method.network == network)
