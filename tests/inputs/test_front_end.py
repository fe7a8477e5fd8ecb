"""The spiking front end: the kernel's spikes are those of its populations, and what a front end must do."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from support.literal import front_end as literal

from lava_vpr.config import preset
from lava_vpr.configfile import update
from lava_vpr.encoding import encode_arrays
from lava_vpr.errors import ConfigError
from lava_vpr.inputs.encoder import EncoderConfig
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.inputs.front_end_settings import EVENT_FRONT_END, FRONT_END
from lava_vpr.synthetic.world import World, render

DEFAULT = EncoderConfig(kind="frontend")


def images(seed: int, spec: FrontEnd) -> NDArray[np.uint8]:
    """Four images with much contrast and little, in part of one grey level, uint8 (4, height, width)."""
    rng = np.random.default_rng(seed)
    shape, least, most = (4, spec.height, spec.width), *np.sort(rng.integers(0, 256, 2)).tolist()
    drawn = rng.integers(least, most + 1, shape)
    drawn[1] = np.where(drawn[1] > (least + most) // 2, 255, 0)
    drawn[2, :, : spec.width // 2] = least
    drawn[3] = np.linspace(least, most, spec.width)
    return drawn.astype(np.uint8)


def events(seed: int, spec: FrontEnd) -> NDArray[np.uint8]:
    """What axons carry of four windows of a sensor, from few events to more than they can, uint8 (4, *shape)."""
    rng = np.random.default_rng(seed)
    height, width = spec.shape
    sensor = (3 * height // 2, 3 * width // 2)
    return np.array([spec.seen(rng.poisson(mean, sensor).astype(np.uint8)) for mean in (0.1, 1, 4, 20)])


@pytest.mark.quick(1)
@pytest.mark.parametrize(("width", "window"), [(8, 0), (16, 0), (8, 1), (8, 3)])
@settings(max_examples=4, deadline=None)
@given(
    seed=st.integers(0, 1 << 32),
    reach=st.integers(0, 2),
    budget=st.integers(1, 60),
    levels=st.integers(2, 40),
    race=st.integers(1, 16),
    most=st.integers(1, 15),
)
def test_the_kernel_spikes_as_the_populations_do(width: int, window: int, seed: int, **numbers: int) -> None:
    spec = FrontEnd(width, window=window, white=5 * window or 255, **numbers)
    shown = events(seed, spec) if window else images(seed, spec)
    films, own = literal.trains(spec, shown), spec.trains(shown)
    assert (films["clock"].sum(axis=1) == 1).all()
    assert (films["pixels"].sum(axis=1) == 1).all()
    assert films["cells"].sum(axis=1).max() <= spec.most
    for name, film in films.items():
        assert np.array_equal(film, own[name]), name
    for number, image in enumerate(shown):
        counts, spikes = spec.spikes(image)
        assert np.array_equal(counts.ravel(), films["cells"][number].sum(axis=0))
        assert spikes.tolist() == [film[number].sum() for film in films.values()][1:]


@pytest.mark.parametrize("sensor", [(96, 128), (80, 80), (32, 64)])
def test_every_event_is_a_spike_of_the_axon_at_its_address(sensor: tuple[int, int]) -> None:
    image = np.zeros(sensor, np.uint8)
    image[-1, 7] = 3
    image[2, 5] = 200  # more than a window's steps
    shown = EVENT_FRONT_END.seen(image)
    (height, width), (rows, columns) = shown.shape, sensor
    at = [(y * height // rows, x * width // columns) for y, x in ((2, 5), (rows - 1, 7))]
    assert [tuple(axon) for axon in np.argwhere(shown)] == at
    assert shown[shown > 0].tolist() == [EVENT_FRONT_END.window, 3]
    spikes = EVENT_FRONT_END.events(shown[None])[0]
    assert np.array_equal(spikes.sum(axis=0), shown.ravel())
    assert not spikes[EVENT_FRONT_END.window :].any()
    assert spikes[: EVENT_FRONT_END.window // 2].sum() == 8 + 1  # evenly over the window


def test_each_pixel_has_events_of_a_sensor_that_has_fewer() -> None:
    shown = EVENT_FRONT_END.seen(np.full((20, 31), 5, np.uint8))
    assert EVENT_FRONT_END.levels_of(shown).all()


def test_what_a_presentation_takes_is_within_what_was_asked() -> None:
    assert FRONT_END.steps == 45 <= 64
    assert FRONT_END.accesses == 1_764_495 <= 1 << 21
    assert FRONT_END.most == 7
    fast = update(preset("fast"), {"encoder": {"kind": "frontend"}})
    assert fast.encoder.front_end is not None
    assert fast.encoder.front_end.steps == 29 <= fast.network.steps == 32


def test_the_longest_front_end_of_settings_is_one() -> None:
    longest = EncoderConfig(kind="frontend", pixel_levels=40, race_steps=16).front_end
    assert longest is not None
    assert longest.steps == 61
    assert longest.numbers.clock.size == 17


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({"width": 18}, r"^a front end's width is 18, but must be a multiple of 4$"),
        ({"cell": 2}, r"^a front end's cell is 2, but must be a multiple of 4$"),
        ({"orientations": 4}, r"^a front end's orientations is 4, but must be a multiple of 8$"),
        ({"levels": 60}, r"^a presentation of 79 steps is longer than 64; use fewer levels$"),
    ],
)
def test_what_does_not_fit_is_refused(numbers: dict[str, int], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        FrontEnd(**numbers)


def test_a_unit_beyond_24_bits_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"^the front end's filters could leave 24 bits; use a smaller unit$"):
        _ = FrontEnd(unit=100).numbers


def test_an_image_without_contrast_is_silent_and_one_turned_dark_is_the_same() -> None:
    """A negative has other levels of the logarithm, but edges where there were some."""
    assert not activity(np.full((48, 64), 90, np.uint8)).any()
    image = render(World(0), 3, "summer")
    edges, negative = activity(image), activity(255 - image)
    assert 0 < edges.max() <= FRONT_END.most
    assert ((edges > 0) == (negative > 0)).mean() > 0.8


@pytest.mark.parametrize("k", range(8))
def test_a_channel_sees_edges_of_its_direction(k: int) -> None:
    """A grating whose gradient runs at 22.5 k degrees, in pixels that are twice as high as they are wide."""
    angle = np.pi * k / 8
    y, x = np.mgrid[:32, :64]
    wave = np.sin((x * np.cos(angle) + 2 * y * np.sin(angle)) * 2 * np.pi / 16)
    channels = activity((128 + 100 * wave).astype(np.uint8)).reshape(8, -1).sum(axis=1)
    assert channels.argmax() == k


@pytest.mark.parametrize(("sizes", "least"), [({"pixel_levels": 32, "race_steps": 15}, 0.8), ({}, 0.75)])
def test_contrast_changes_little_because_what_is_around_divides(sizes: dict[str, int], least: float) -> None:
    """Less, the more levels of a pixel there are."""
    encoder = dataclasses.replace(DEFAULT, **sizes)
    image = render(World(0), 5, "summer").astype(float)
    full, half = (activity((128 + share * (image - 128)).astype(np.uint8), encoder) for share in (1, 0.5))
    assert np.corrcoef(full, half)[0, 1] > least


def activity(image: NDArray[np.uint8], encoder: EncoderConfig = DEFAULT) -> NDArray[np.float32]:
    return encode_arrays([image], encoder)[0].activity[0]
