"""Extended, merged and cut down, a map is what is trained together, byte for byte, and nothing is learned twice."""

from __future__ import annotations

import dataclasses
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.small_models import encoded, small_config, small_model

from benchmarks.places import encoded as encoded_nordland, learn
from lava_vpr import maps, model
from lava_vpr.cluster.tasks import Pool
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.deploy.boards.board import BOARDS
from lava_vpr.deploy.bundle.deployment import deploy
from lava_vpr.deploy.bundle.learning import chip_learning
from lava_vpr.deploy.bundle.targets import open_bundle
from lava_vpr.encoding import EncodedTraverse, Keep, encode_arrays
from lava_vpr.engine.inference import counting, fixed, quantise
from lava_vpr.engine.rates import query_rates16
from lava_vpr.errors import ConfigError, InputError, ModelFileError
from lava_vpr.inputs.views import STRAIGHT
from lava_vpr.matching.equations import assign
from lava_vpr.model import Model, integer_model
from lava_vpr.positions.frames import Positions
from lava_vpr.recognition import DECODERS_ONLY, recognise
from lava_vpr.training.loop import train
from lava_vpr.training.measuring import response_keys

CUTS = (8, 5)
"""Places of the first map, and of what it is extended by: two stretches of 4, and stretches of 2 and 3."""
PLACES = sum(CUTS)
KINDS: dict[str, dict[str, Any]] = {
    "float": {},
    "integer": {"learning": {"arithmetic": "integer"}},
    "template": {"learning": {"rule": "template", "epochs": 1}},
    "views": {"views": {"shifts": 3}},
    "whole": {"stretch": 0},
    "more": {"network": {"neurons_per_place": 1.5, "signed": False}},
    "surroundings": {"network": {"surroundings": 2}},
}
"""Settings, by name."""
SHARE = 0.5
HERE = Positions(np.arange(2.0 * PLACES).reshape(PLACES, 2), "xy")


@dataclasses.dataclass(frozen=True)
class Case:
    """References of a whole route, and the settings that they are learned with."""

    config: Config
    references: tuple[EncodedTraverse, ...]
    positions: Positions | None = None

    def part(self, first: int, end: int, shift: int = 0) -> list[EncodedTraverse]:
        """The references of some places, their indices ``shift`` less."""
        parts = [reference.take(slice(first, end)) for reference in self.references]
        return [dataclasses.replace(part, indices=part.indices - shift) for part in parts]

    def trained(self, first: int, end: int, shift: int = 0, route_images: int | None = None, **options: Any) -> Model:
        own = None if self.positions is None else self.positions.take(slice(first, end))
        references = self.part(first, end, shift)
        return train(references, self.config, positions=own, route_images=route_images, pool=Pool(2), **options)


def case(kind: str, traverses: int = 1, hog: bool = True, positions: bool = False) -> Case:
    config = update(small_config(learning={"epochs": 2}), KINDS[kind])
    shown = []
    for number in range(traverses * len(config.views.views)):
        seen = encoded(PLACES, seed=number)
        activity = ordered(seen.activity) if kind == "surroundings" else seen.activity
        whole = dataclasses.replace(seen, activity=activity, indices=np.arange(PLACES), hog=seen.hog if hog else None)
        # A model keeps the thumbnails of its first traverse alone.
        shown.append(whole if number < len(config.views.views) else dataclasses.replace(whole, thumbnails=None))
    return Case(config, tuple(shown), HERE if positions else None)


def ordered(activity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Images of a drive, float32 (n, inputs): each shares something with those beside it, and less with the next."""
    beside = sum(np.roll(activity, shift, axis=0) for shift in range(-2, 3))
    return np.asarray(activity + np.float32(SHARE) * beside, np.float32)


def file_of(made: Model, folder: Path) -> bytes:
    model.save(made, folder / "m.lvpr")
    return (folder / "m.lvpr").read_bytes()


def test_surroundings_change_weights_here() -> None:
    """Else the maps of that kind would prove nothing."""
    some = case("surroundings")
    plain = dataclasses.replace(some, config=update(some.config, {"network": {"surroundings": 0}}))
    found, without = (integer_model(one.trained(0, PLACES), "comparing") for one in (some, plain))
    assert np.count_nonzero(found.network.weights != without.network.weights) > 100


@pytest.mark.quick(9)
@pytest.mark.parametrize(
    ("kind", "options"),
    [
        *((kind, {}) for kind in KINDS),
        ("float", {"traverses": 2, "positions": True}),
        ("views", {"traverses": 2}),
        ("float", {"hog": False}),
    ],
)
@pytest.mark.parametrize("same_traverse", [False, True])
def test_extend_is_merge_is_training_together(
    kind: str, options: dict[str, Any], same_traverse: bool, tmp_path: Path
) -> None:
    """Whether the new places are another part of one traverse, or another traverse whose indices are counted on."""
    whole = case(kind, **options)
    shift, images = (0, PLACES) if same_traverse else (CUTS[0], None)
    together = file_of(whole.trained(0, PLACES, parts=CUTS), tmp_path)
    first, second = whole.trained(0, CUTS[0], 0, images), whole.trained(CUTS[0], PLACES, shift, images)
    before = file_of(first, tmp_path)
    extended = maps.extend(
        first,
        whole.part(CUTS[0], PLACES, shift),
        route_images=images,
        positions=None if whole.positions is None else whole.positions.take(slice(CUTS[0], PLACES)),
    )
    assert file_of(extended, tmp_path) == together
    assert file_of(maps.merge([first, second]), tmp_path) == together
    assert file_of(first, tmp_path) == before
    assert dataclasses.asdict(model.load(tmp_path / "m.lvpr"))  # it can be read again
    # What was learned stands where its stretch does, bit for bit.
    for stretch in first.stretches:
        new = next(s for s in extended.stretches if (s.view, s.first_place) == (stretch.view, stretch.first_place))
        old = first.learned[:, stretch.first_neuron : stretch.first_neuron + stretch.neurons]
        np.testing.assert_array_equal(extended.learned[:, new.first_neuron : new.first_neuron + new.neurons], old)


def test_extending_again_and_by_one_place(tmp_path: Path) -> None:
    whole = case("float")
    grown: Model = whole.trained(0, 8)
    for place in (8, 9):
        grown = maps.extend(grown, whole.part(place, place + 1, place))
    assert file_of(grown, tmp_path) == file_of(whole.trained(0, 10, parts=(8, 1, 1)), tmp_path)
    three = maps.merge([whole.trained(0, 4), whole.trained(4, 8, 4), whole.trained(8, PLACES, 8)])
    assert file_of(three, tmp_path) == file_of(whole.trained(0, PLACES, parts=(4, 4, 5)), tmp_path)


def test_indices_are_kept_or_counted_on() -> None:
    """Those of the same traverse stay; where lengths differ, or an index is known, the route goes on."""
    whole = case("template")
    first = whole.trained(0, 4, route_images=20)
    for new, route_images, indices, route in (
        (whole.part(8, 12), 20, [8, 9, 10, 11], 20),
        (whole.part(8, 12), 21, [28, 29, 30, 31], 41),
        (whole.part(3, 7), 20, [23, 24, 25, 26], 40),
        (whole.part(8, 12, 8), None, [20, 21, 22, 23], 24),
    ):
        made = maps.extend(first, new, route_images=route_images, allow_duplicates=True)
        assert made.place_indices.tolist() == [0, 1, 2, 3, *indices]
        assert (made.route_images, made.place_names[4:]) == (route, new[0].names)


def test_images_in_memory(tmp_path: Path) -> None:
    """Pixels are encoded as the model's own were."""
    rng = np.random.default_rng(0)
    pictures = [np.kron(rng.integers(0, 255, (6, 8), np.uint8), np.ones((8, 8), np.uint8)) for _ in range(6)]
    config, names = small_config(learning={"epochs": 1}), [f"{k}.png" for k in range(6)]
    first = train(encode_arrays(pictures[:4], config.encoder, (STRAIGHT,), Keep.ALL, names[:4]), config)
    made = maps.extend(first, np.stack(pictures[4:]), names=names[4:])
    whole = encode_arrays(pictures, config.encoder, (STRAIGHT,), Keep.ALL, names)
    assert file_of(made, tmp_path) == file_of(train(whole, config, parts=(4, 2)), tmp_path)
    assert maps.extend(first, pictures[4:]).place_names[4:] == ("image 000000", "image 000001")
    for images, names_, text in (
        ([np.zeros((4, 4))], None, "image 0 is of type float64 and shape"),
        ([np.zeros((4, 4, 2), np.uint8)], None, "image 0 is of type uint8 and shape"),
        (pictures[4:], ["a"], "1 names for 2 images"),
        (np.zeros((0, 4, 4), np.uint8), None, "a map is extended by at least 1 place, but there is no image"),
        ([np.zeros((8, 8), np.uint8)], None, "they are blank"),
    ):
        with pytest.raises(InputError, match=text):
            maps.extend(first, images, names=names_)


@cache
def together(kind: str = "float", traverses: int = 1) -> Model:
    return case(kind, traverses, positions=True).trained(0, PLACES)


@pytest.mark.parametrize(("kind", "traverses"), [("float", 1), ("float", 2), ("views", 1), ("more", 1)])
@pytest.mark.parametrize("gone", [[0], [3, 4, 11], [4, 5, 6, 7, 8], list(range(11))])
def test_remove(kind: str, traverses: int, gone: list[int], tmp_path: Path) -> None:
    """Places go with their neurons; the others' learned weights stay, and all the rest is made of these."""
    whole = together(kind, traverses)
    made = maps.remove(whole, gone)
    left = [place for place in range(PLACES) if place not in gone]
    assert made.place_indices.tolist() == left
    assert made.place_names == tuple(whole.place_names[place] for place in left)
    assert made.route_images == whole.route_images
    images = np.isin(whole.labels, left)
    for name in ("activity", "patches", "hog"):
        np.testing.assert_array_equal(getattr(made, name), getattr(whole, name)[images])
    np.testing.assert_array_equal(made.thumbnails, whole.thumbnails[left])
    np.testing.assert_array_equal(made.positions, HERE.values[left])
    # Neuron by neuron, in plain words.
    kept: list[int] = []
    for stretch in whole.stretches:
        own = range(stretch.first_place, stretch.first_place + stretch.places)
        for neuron in range(stretch.first_neuron, stretch.first_neuron + stretch.neurons):
            spikes = [int(whole.responses[neuron, place]) for place in own]
            stands_for = own[spikes.index(max(spikes))] if max(spikes) else None
            if stands_for not in gone and set(own) - set(gone):
                kept.append(neuron)
    np.testing.assert_array_equal(made.learned, whole.learned[:, kept])
    assert len(kept) < whole.neurons
    # The network of these weights and references, made again.
    rates = query_rates16(made.activity, made.config.encoder)
    weights = quantise.integer_weights(
        quantise.distinctive(np.ascontiguousarray(whole.learned[:, kept]), made.config.network),  # type: ignore[arg-type]
        3,
    )
    assert isinstance(made.network, fixed.FixedNetwork)
    np.testing.assert_array_equal(made.network.weights, weights)
    counts, _, _ = counting.count_spikes(made.network, rates, response_keys(rates, made.config.seed))
    responses = sum(counts[start : start + len(left)].T for start in range(0, len(rates), len(left)))
    np.testing.assert_array_equal(made.responses, responses)
    assert sum(s.removed + s.places for s in made.stretches) == sum(
        s.places for s in whole.stretches if set(range(s.first_place, s.first_place + s.places)) - set(gone)
    )
    model.save(made, tmp_path / "m.lvpr")
    assert model.load(tmp_path / "m.lvpr").stretches == made.stretches


def test_removed_places_can_be_learned_again() -> None:
    """What comes back stands at the end, with the indices that it had; what was removed twice is counted."""
    whole = case("float", positions=True)
    model_ = together()
    cut = maps.remove(maps.remove(model_, [4]), [5])
    assert [s.removed for s in cut.stretches] == [s.removed for s in maps.remove(model_, [4, 5]).stretches]
    again = maps.extend(cut, whole.part(4, 6), route_images=PLACES, positions=HERE.take(slice(4, 6)))
    assert again.place_indices.tolist() == [0, 1, 2, 3, *range(6, PLACES), 4, 5]
    assert again.positions is not None
    np.testing.assert_array_equal(again.positions, HERE.values[again.place_indices])
    assert sorted(assign(again.responses)[-2:].tolist()) == [PLACES - 2, PLACES - 1]
    assert len(maps.merge([cut, together("float")], allow_duplicates=True).stretches) == len(cut.stretches) + len(
        model_.stretches
    )


@pytest.mark.parametrize("adapt", [0, 50])
def test_maps_that_adapt_otherwise_merge_and_adapt_as_the_first(adapt: int) -> None:
    model = small_model()
    other = dataclasses.replace(model, config=update(model.config, {"network": {"adapt": adapt}}))
    for first, second in ((model, other), (other, model)):
        assert maps.merge([first, second], allow_duplicates=True).config == first.config


def test_a_map_beyond_the_limits_is_refused_before_it_is_learned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 13 places; the 8 and the 5 that it would be made of are within the limits."""
    whole = case("template")
    first, second = whole.trained(0, CUTS[0]), whole.trained(CUTS[0], PLACES, CUTS[0])
    monkeypatch.setenv("LAVA_VPR_MAX_MODEL_BYTES", "900000")
    for attempt in (
        lambda: maps.extend(first, whole.part(CUTS[0], PLACES, CUTS[0]), progress=lambda _: pytest.fail("it learned")),
        lambda: maps.merge([first, second]),
    ):
        with pytest.raises(ConfigError, match=r"a model of 13 places and 13 neurons takes .*, more than the 900,000"):
            attempt()


def test_a_map_without_a_neuron_is_refused() -> None:
    """All neurons may respond most to places that go."""
    made = small_model()
    silent = np.zeros_like(made.responses)
    silent[:4, 0] = silent[4:, 4] = 9
    with pytest.raises(InputError, match="no neuron would be left for the other places"):
        maps.remove(dataclasses.replace(made, responses=silent), [5, 9])
    left = maps.remove(dataclasses.replace(made, responses=silent), [5])
    assert [(s.places, s.neurons, s.removed) for s in left.stretches] == [(3, 0, 1), (4, 4, 0)]
    with pytest.raises(ConfigError, match="needs neurons, but those of places 0:3 were removed; train again"):
        chip_learning(left)


def test_images_that_the_map_has_already_are_refused_unless_allowed(caplog: pytest.LogCaptureFixture) -> None:
    whole = case("template")
    first = whole.trained(0, CUTS[0])
    maps.extend(first, whole.part(CUTS[0], PLACES, CUTS[0]))
    is_6, is_7, names = (
        "img6.png is place 6 (img6.png)",
        "img7.png is place 7 (img7.png)",
        ("img0.png is place 0 (img0.png), img1.png is place 1 (img1.png), img2.png is "),
    )
    twice = [  # among what is added, place 2 is place 0
        dataclasses.replace(part.take([0, 1, 0]), indices=np.arange(3)) for part in whole.part(CUTS[0], PLACES)
    ]
    for attempt, said in (
        (
            partial(maps.extend, first, whole.part(CUTS[0] - 2, PLACES, CUTS[0] - 2)),
            f"2 of the 7 places added show images that the map has already: {is_6}, {is_7}",
        ),
        (
            partial(maps.extend, first, twice),
            "1 of the 3 places added show images that the map has already: img8.png is place 0 (img8.png)",
        ),
        (
            partial(maps.merge, [first, first]),
            f"8 of the 8 places added show images that the map has already: {names}place 2 (img2.png), and 5 more",
        ),
    ):
        with pytest.raises(InputError) as caught:
            attempt()
        assert str(caught.value).split(";")[0] == said
        assert not caplog.messages
        made = attempt(allow_duplicates=True)
        assert made.places == CUTS[0] + int(said.split()[3])
        assert caplog.messages == [said]
        caplog.clear()


def test_a_silent_neuron_stays() -> None:
    """It stands for no place, so it goes with none; one that answers a place of another stretch more keeps its own."""
    made = small_model()
    responses = np.zeros_like(made.responses)
    responses[0, 3], responses[1, 2], responses[1, 7] = 5, 5, 9
    left = maps.remove(dataclasses.replace(made, responses=responses), [8, 12])
    np.testing.assert_array_equal(left.learned, made.learned[:, 1:])
    assert [(s.places, s.neurons, s.removed) for s in left.stretches] == [(3, 3, 1), (3, 4, 1)]


def test_a_chip_learns_the_stretches_of_an_extended_map(tmp_path: Path) -> None:
    """Its learning networks are those of training together: start weights, noise and seeds; a bundle holds them."""
    whole = case("integer")
    grown = maps.extend(whole.trained(0, CUTS[0]), whole.part(CUTS[0], PLACES, CUTS[0]))
    together_ = whole.trained(0, PLACES, parts=CUTS)
    for ours, theirs in zip(chip_learning(grown), chip_learning(together_), strict=True):
        assert ours.seeds == theirs.seeds
        for name in ("epochs", "images", "keys", "rates"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
        np.testing.assert_array_equal(ours.start.weights, theirs.start.weights)
    less = maps.remove(grown, [1, 9])
    deploy(less, BOARDS["loihi2"], tmp_path / "bundle", learning=True, picture=False)
    opened = open_bundle(tmp_path / "bundle")
    assert opened.stretches == less.stretches
    with pytest.raises(ModelFileError, match="extending needs what the network has learned"):
        maps.extend(opened, whole.part(0, 1))


@pytest.mark.data
@pytest.mark.slow
def test_an_extended_map_of_real_images(data_root: Path) -> None:
    """490 places of Nordland and 10 more: what was learned stays, and each part is recognised as if learned at once."""
    config = preset("loihi")
    first = learn((0, 490), config)
    new = encoded_nordland("summer", config.encoder).take(slice(490, 500))
    grown = maps.extend(first, [new], route_images=500, pool=Pool(2))
    np.testing.assert_array_equal(grown.learned[:, :490], first.learned)
    together = learn((0, 500), config)
    for first_place, end in ((0, 490), (490, 500)):
        queries = encoded_nordland("winter", config.encoder).take(slice(first_place, end))
        truth = queries.indices[:, None] == grown.place_indices
        found = [recognise(made, queries, truth, DECODERS_ONLY, pool=Pool(2)) for made in (grown, together)]
        ours, theirs = (result.metrics[result.default].recall_at_1 for result in found)
        assert ours >= theirs - 0.02
