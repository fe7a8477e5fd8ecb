"""What vectors are measured by: chosen and fitted on the references, before anything is learned of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lava_vpr.config import Config, StdpLearning, preset
from lava_vpr.encoding import check_seen
from lava_vpr.engine.random import presentation_key, uniform
from lava_vpr.errors import ConfigError, InputError
from lava_vpr.inputs.encoder import INPUTS, EncoderConfig
from lava_vpr.inputs.vectors import Standard, width_for
from lava_vpr.storage.text import shown
from lava_vpr.traverse import Traverse

_FLAT = 1e-3
"""A value that varies less than this share of what all vary has that share for its own scale."""


def settings_for(config: Config, traverses: Sequence[Traverse]) -> Config:
    """``config`` for what the references are: settings for images become those for vectors where these are given.

    Settings for images become the input ``vector``. Of these, what is as the preset has it becomes what was chosen for
    vectors: all inputs may spike in a query, since the dead zone keeps the weak ones silent already; and learning shows
    each vector for twice the steps, since as many spikes are shared by more inputs.

    Args:
        config: Settings.
        traverses: The references.
    Raises:
        InputError: some are images and some vectors, or of different sizes, or they are images and ``config`` says
            that they are vectors.
        ConfigError: the settings cannot take vectors.
    """
    first = traverses[0].stored
    for traverse in traverses[1:]:
        if (traverse.stored is None) != (first is None):
            kinds = ("images", "vectors") if first is None else ("vectors", "images")
            raise InputError(
                f"{shown(traverse.source)}: holds {kinds[1]}, {shown(traverses[0].source)} {kinds[0]}; give one sort"
            )
    encoder = config.encoder
    if first is None:
        if INPUTS[encoder.kind].sees == "vector":
            check_seen(traverses[0], encoder)
        return config
    if INPUTS[encoder.kind].sees != "vector":
        config = _of_vectors(config)
        encoder = config.encoder
    if encoder.vector_values not in (0, first.values):
        raise ConfigError(
            f"encoder.vector_values is {encoder.vector_values}, but {shown(traverses[0].source)} holds vectors of "
            f"{first.values:,} values; leave it out of the settings"
        )
    encoder = dataclasses.replace(encoder, vector_values=first.values)
    for traverse in traverses[1:]:
        check_seen(traverse, encoder)
    return dataclasses.replace(config, encoder=encoder)


def _of_vectors(config: Config) -> Config:
    """Settings for images as settings for vectors."""
    usual, encoder, learning = preset(config.preset), config.encoder, config.learning
    shown = 0 if encoder.query_inputs == usual.encoder.query_inputs else encoder.query_inputs
    if isinstance(learning, StdpLearning) and learning.steps == StdpLearning.steps:
        learning = dataclasses.replace(learning, steps=2 * learning.steps)
    encoder = dataclasses.replace(encoder, kind="vector", query_inputs=shown)
    return dataclasses.replace(config, encoder=encoder, learning=learning)


def check_asked(traverses: Sequence[Traverse], config: Config) -> None:
    """Refuse references that the kind of input which a user named cannot see.

    Raises:
        InputError: they are vectors, and it sees images, or the other way round.
    """
    encoder = config.encoder
    for traverse in traverses:
        if (INPUTS[encoder.kind].sees == "vector") != (traverse.stored is not None):
            check_seen(traverse, encoder)


def fitted(config: Config, traverses: Sequence[Traverse]) -> Standard | None:
    """What the vectors of ``traverses`` are measured by; None if the settings are for inputs that need none.

    The mean of each value is that of all references. Their spread is one scale for all values, or each its own. The
    signs and choices of a projection are drawn from the seed alone.

    Raises:
        InputError: all vectors are equal.
    """
    encoder = config.encoder
    if not INPUTS[encoder.kind].standardised:
        return None
    mean, spread = _moments(traverses, encoder.vector_values)
    if not spread.any():
        raise InputError(
            f"{shown(traverses[0].source)}: all vectors are equal, so nothing tells places apart; compute them again"
        )
    shared = np.sqrt((spread**2).mean())
    own = np.maximum(spread, _FLAT * shared) if encoder.vector_scale == "own" else np.full(len(spread), shared)
    signs, kept = _projection(encoder, config.seed)
    return Standard(mean.astype(np.float32), own.astype(np.float32), signs, kept)


def standard_like(other: Standard | None, config: Config) -> Standard:
    """``other``, which another model has, seen to be one for vectors of these settings.

    Raises:
        ConfigError: it is not.
    """
    encoder = config.encoder
    if other is None:
        raise ConfigError("--standard names a model that was not trained with vectors; name one that was")
    wanted = min(encoder.vector_values, encoder.vector_kept)
    seen = len(other.kept) if other.projects else other.values
    if not INPUTS[encoder.kind].standardised or other.values != encoder.vector_values or seen != wanted:
        raise ConfigError(
            f"--standard names a model of vectors of {other.values:,} values, {seen:,} of them seen, but these are of "
            f"{encoder.vector_values:,}, {wanted:,} seen; train with the settings of that model"
        )
    return other


def in_words(config: Config, standard: Standard) -> str:
    """What is said of vectors that are learned."""
    encoder = config.encoder
    seen = min(encoder.vector_values, encoder.vector_kept)
    projected = f", projected on {seen:,} (encoder.vector_kept)" if standard.projects else ""
    said = f"vectors of {encoder.vector_values:,} values, standardised on the references{projected}"
    return f"{said}: {encoder.inputs:,} inputs"


def _moments(traverses: Sequence[Traverse], values: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and standard deviation of each value over all vectors, float64 (values,); added one vector at a time."""
    count, total = 0, np.zeros(values)
    for traverse in traverses:
        for vector in traverse.images():
            total += vector
            count += 1
    mean, squares = total / count, np.zeros(values)
    for traverse in traverses:
        for vector in traverse.images():
            squares += (vector - mean) ** 2
    return mean, np.sqrt(squares / count)


def _projection(encoder: EncoderConfig, seed: int) -> tuple[NDArray[np.int8], NDArray[np.int32]]:
    """Signs and kept numbers of the projection of vectors, both empty where they are not longer than is kept."""
    if encoder.vector_values <= encoder.vector_kept:
        return np.zeros(0, np.int8), np.zeros(0, np.int32)
    width = width_for(encoder.vector_values)
    draws = uniform(presentation_key(seed, "projection", 0), 2 * width)
    kept = np.sort(np.argsort(draws[width:], kind="stable")[: encoder.vector_kept])
    return np.where(draws[:width] < 0.5, 1, -1).astype(np.int8), kept.astype(np.int32)
