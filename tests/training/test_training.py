"""The training loop: same model whatever the threads, the interruptions and the batches."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.common.small_models import encoded, small_config, small_model, tiny_paper

from lava_vpr import model
from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.config import Config, preset
from lava_vpr.configfile import update
from lava_vpr.encoding import EncodedTraverse
from lava_vpr.engine.learning.recruiting import key_again
from lava_vpr.engine.random import image_keys, presentation_key
from lava_vpr.engine.rates import query_rates, training_rates
from lava_vpr.errors import ConfigError, InputError, ModelFileError, NetworkLimitError
from lava_vpr.model import Model, integer_model
from lava_vpr.storage import container
from lava_vpr.training.loop import check_size, presentations, split, train
from lava_vpr.training.measuring import coverage, reference_responses
from lava_vpr.training.stretches import Progress, epochs_done


class KilledError(Exception):
    """Stands for whatever ends a training before it is done."""


def stop_after(n: int):
    seen = []

    def progress(state: Progress) -> None:
        seen.append(state)
        if len(seen) == n:
            raise KilledError

    return progress


def same(a: Model, b: Model, tmp_path: Path) -> bool:
    model.save(a, tmp_path / "one")
    model.save(b, tmp_path / "two")
    return (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def cases() -> list[tuple[str, Config, list[EncodedTraverse]]]:
    two = [encoded(), dataclasses.replace(encoded(noise=0.5), indices=np.arange(8) + 5)]
    return [
        ("one traverse", small_config(), [encoded()]),
        ("two traverses", small_config(), two),
        ("integers", small_config(learning={"arithmetic": "integer"}), [encoded()]),
        ("templates", small_config(learning={"rule": "template"}), two),
        ("paper", tiny_paper(), [encoded(inputs=784)]),
    ]


@pytest.mark.parametrize(("config", "references"), [c[1:] for c in cases()], ids=[c[0] for c in cases()])
@pytest.mark.parametrize("after", [13, 21])
def test_a_resumed_training_is_bit_identical(
    config: Config, references: list[EncodedTraverse], after: int, tmp_path: Path
) -> None:
    unbroken = train(references, config)
    checkpoint = tmp_path / "a.checkpoint"
    with pytest.raises(KilledError):
        train(references, config, checkpoint=checkpoint, interval=0.0, progress=stop_after(after))
    assert checkpoint.exists()
    told: list[dict[int, int]] = []
    resumed = train(references, config, checkpoint=checkpoint, resume=True, resumed=told.append)
    assert told
    assert 0 < sum(told[0].values()) < config.learning.epochs * len(unbroken.stretches)
    assert same(unbroken, resumed, tmp_path)


def test_threads_do_not_matter(tmp_path: Path) -> None:
    assert same(
        train([encoded()], small_config(), pool=ONE_THREAD), train([encoded()], small_config(), pool=Pool(2)), tmp_path
    )


def test_seeds_do(tmp_path: Path) -> None:
    other = dataclasses.replace(small_config(), seed=1)
    assert not same(train([encoded()], small_config()), train([encoded()], other), tmp_path)


@pytest.mark.parametrize("change", ["options", "images", "missing", "damaged", "nowhere"])
def test_a_checkpoint_of_something_else_is_refused(change: str, tmp_path: Path) -> None:
    checkpoint = tmp_path / "a.checkpoint"
    config, images = small_config(), [encoded()]
    with pytest.raises(KilledError):
        train(images, config, checkpoint=checkpoint, interval=0.0, progress=stop_after(13))
    message = r"a\.checkpoint: was made with other options or images; repeat the original command"
    if change == "options":
        config = update(config, {"learning": {"eta": 0.2}})
    elif change == "images":
        images = [encoded(seed=1)]
    elif change == "missing":
        checkpoint.unlink()
        message = r"a\.checkpoint: there is no checkpoint to resume from; train without --resume"
    elif change == "damaged":
        checkpoint.write_bytes(checkpoint.read_bytes()[:-9])
        message = r"a\.checkpoint: the checkpoint is damaged .*; delete it and train from the start"
    with pytest.raises(ModelFileError, match=message if change != "nowhere" else "nowhere to resume from"):
        train(images, config, checkpoint=None if change == "nowhere" else checkpoint, resume=True)


def test_a_checkpoint_holds_whole_epochs_of_every_stretch(tmp_path: Path) -> None:
    checkpoint = tmp_path / "a.checkpoint"
    with pytest.raises(KilledError):
        train([encoded()], small_config(), checkpoint=checkpoint, interval=0.0, progress=stop_after(27))
    header, arrays = container.load(checkpoint, "checkpoint")
    assert header["epochs"] == {"0": 5, "1": 1}
    assert set(arrays) == {"0.weights", "0.theta", "1.weights", "1.theta"}


def test_what_was_done_before_is_one_short_line() -> None:
    assert epochs_done({0: 3}, 6, 1) == "epochs done: stretch 1: 3 of 6"
    assert epochs_done({0: 6}, 6, 1) == "stretches finished: 1 of 1"
    some = {0: 6, 2: 1, 1: 6, 3: 2}
    assert epochs_done(some, 6, 40) == "epochs done: stretch 3: 1 of 6, stretch 4: 2 of 6; stretches finished: 2 of 40"
    many = epochs_done(dict.fromkeys(range(200), 2), 6, 400)
    assert many.endswith("stretch 3: 2 of 6 and 197 more; stretches finished: 0 of 400")


def test_no_checkpoint_is_left_before_the_first_epoch(tmp_path: Path) -> None:
    checkpoint = tmp_path / "a.checkpoint"
    with pytest.raises(KilledError):
        train([encoded()], small_config(), checkpoint=checkpoint, interval=0.0, progress=stop_after(2))
    assert not checkpoint.exists()


@pytest.mark.parametrize(
    ("places", "stretch", "expected"),
    [(100, 100, [100]), (101, 100, [50, 51]), (500, 100, [100] * 5), (7, 0, [7]), (7, 3, [2, 3, 2]), (3, 100, [3])],
)
def test_routes_are_cut_evenly(places: int, stretch: int, expected: list[int]) -> None:
    parts = split(places, dataclasses.replace(preset("loihi"), stretch=stretch))
    assert [p.places for p in parts] == expected
    assert [p.first_place for p in parts] == np.cumsum([0, *expected[:-1]]).tolist()
    assert [p.first_neuron for p in parts] == np.cumsum([0, *(p.neurons for p in parts[:-1])]).tolist()


def test_every_place_is_learned() -> None:
    learned = train([encoded(20)], update(small_config(), {"stretch": 10, "learning": {"epochs": 8, "steps": 200}}))
    assert learned.training["places_covered"] >= 18
    assert learned.responses.shape == (20, 20)
    assert learned.weight_bits == 3
    # Places of one stretch are learned by its own neurons.
    own = learned.neuron_places()
    assert np.mean(own[:10] < 10) > 0.8
    assert np.mean(own[10:] >= 10) > 0.8


def test_unequal_references_and_too_short_routes_are_refused() -> None:
    with pytest.raises(InputError, match="reference traverse 2 has 7 images, the first has 8"):
        train([encoded(8), encoded(7)], small_config())
    with pytest.raises(InputError, match="at least 2 places"):
        train([encoded(1)], small_config())
    with pytest.raises(InputError, match="at least 2 places"):
        train([], small_config())


def test_integer_learning_that_cannot_be_is_refused_before_anything_is_learned() -> None:
    integer = update(preset("loihi"), {"stretch": 0, "learning": {"arithmetic": "integer"}})
    check_size(3000, integer)  # one inhibitory neuron takes the same however many spike
    with pytest.raises(NetworkLimitError, match=r"inhibition is .* while learning, .*; lower learning\.inhibition"):
        check_size(10, update(integer, {"learning": {"inhibition": 9000.0}}))
    with pytest.raises(ConfigError, match=r"^learning.mu is 0.5, but must be 0, 1 or 2 with --learning integer"):
        check_size(10, update(integer, {"learning": {"mu": 0.5}}))


def test_integer_learning_gives_a_model_of_its_own() -> None:
    integer = train([encoded()], small_config(learning={"arithmetic": "integer"}))
    np.testing.assert_allclose(integer.learned.mean(axis=0), 0.1, rtol=1e-4)  # as after learning in float
    assert coverage(integer.responses)[1] >= 6
    assert not np.array_equal(integer.responses, train([encoded()], small_config()).responses)


@pytest.mark.parametrize("error", [ConfigError, NetworkLimitError])
def test_a_network_that_turns_out_to_be_none_leaves_no_checkpoint(
    error: type[Exception], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise error("too large")

    monkeypatch.setattr("lava_vpr.training.loop.integer_network", refuse)
    with pytest.raises(error, match="too large"):
        train([encoded()], small_config(), checkpoint=tmp_path / "a.checkpoint", interval=0.0)
    assert not list(tmp_path.iterdir())


def test_the_conductance_model_refuses_stretches_before_it_learns() -> None:
    with pytest.raises(ConfigError, match="in one network; use --stretch 0"):
        train([encoded(inputs=784)], dataclasses.replace(tiny_paper(), stretch=3), progress=stop_after(1))


def test_blank_images_are_refused_before_anything_is_learned() -> None:
    blank = dataclasses.replace(encoded(), activity=np.zeros((8, 1568), np.float32))
    with pytest.raises(InputError, match="no input responds to any reference: they are blank; give images"):
        train([blank, blank], small_config(), progress=stop_after(1))


def test_a_blank_place_stays_unknown_beside_others() -> None:
    activity = encoded().activity.copy()
    activity[5] = 0
    learned = train([dataclasses.replace(encoded(), activity=activity)], small_config())
    assert not learned.responses[:, 5].any()
    assert coverage(learned.responses)[1] >= 6


def test_progress_tells_what_was_learned() -> None:
    seen: list[Progress] = []
    train([encoded()], small_config(), progress=seen.append)
    assert len(seen) == 8 * 5
    whole = [state for state in seen if state.neurons_used >= 0]
    assert len(whole) == 2 * 5
    assert whole[-1].spikes_per_image > 0
    assert 0 < whole[-1].places_covered <= 4


def test_no_two_training_presentations_share_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[int] = []

    def recorded(key: int, times: int) -> int:
        drawn.append(key_again(key, times))
        return drawn[-1]

    monkeypatch.setattr("lava_vpr.training.stretches.key_again", recorded)
    train([encoded(), encoded(), encoded()], small_config())
    # Two epochs of the first traverse alone, three of all; and some place three times more, of all three.
    assert len(drawn) == len(set(drawn)) > 2 * 8 + 3 * 3 * 8
    assert (len(drawn) - 88) % 9 == 0
    rates = {"query": query_rates, "response": query_rates, "train": training_rates}
    keys = {role: image_keys(of(encoded().activity, small_config())).tolist() for role, of in rates.items()}
    roles = {presentation_key(0, role, image) for role in ("response", "query") for image in keys[role] + keys["train"]}
    assert not roles & set(drawn)


@pytest.mark.parametrize("arithmetic", ["float", "integer"])
def test_a_stretch_learns_its_own_images_alone(arithmetic: str) -> None:
    """Neither its place in the route, nor the indices and names, nor the other stretches change what it learns."""
    config, whole = small_config(learning={"arithmetic": arithmetic, "epochs": 2}), encoded(12)
    learned = train([whole], config).learned
    for first, end in ((0, 4), (4, 8), (4, 12)):
        own = dataclasses.replace(whole.take(slice(first, end)), indices=np.arange(end - first)[::-1] + 77)
        np.testing.assert_array_equal(train([own], config).learned, learned[:, first:end])
    assert len({column.tobytes() for column in learned.T}) == 12
    twins = train([encoded(4), encoded(4, noise=1.0)], config).learned
    assert not np.array_equal(twins, learned[:, :4])


@pytest.mark.parametrize(
    ("parts", "cut"), [((), [4, 4, 4]), ((8, 4), [4, 4, 4]), ((9, 3), [3, 3, 3, 3]), ((1, 11), [1, 4, 3, 4])]
)
def test_parts_of_a_route_are_cut_by_themselves(parts: tuple[int, ...], cut: list[int]) -> None:
    for views in (1, 3):
        stretches = split(12, small_config(views={"shifts": views}), parts)
        assert [stretch.places for stretch in stretches] == cut * views
        assert [stretch.view for stretch in stretches] == [view for view in range(views) for _ in cut]
        ends = np.cumsum([0, *cut])[:-1].tolist()
        assert [stretch.first_place for stretch in stretches] == ends * views
        assert [stretch.first_neuron for stretch in stretches] == np.cumsum([0, *cut * views])[:-1].tolist()


@pytest.mark.parametrize("parts", [(12, 1), (11,), (12, 0), (13, -1)])
def test_parts_that_are_not_the_route_are_refused(parts: tuple[int, ...]) -> None:
    with pytest.raises(ConfigError, match=r"parts of .* of a route of 12; give parts"):
        train([encoded(12)], small_config(), parts=parts)


def test_a_references_response_is_its_own() -> None:
    """Neither the order of traverses nor that of places changes what an image adds to S^R."""
    model, first, second = small_model(), encoded().activity, encoded(seed=5).activity
    network = integer_model(model, "this test").network

    def responses(*traverses: NDArray[np.float32]) -> NDArray[Any]:
        return reference_responses(network, np.concatenate(traverses), model.places, model.config, ONE_THREAD)

    np.testing.assert_array_equal(responses(second, first), responses(first, second))
    np.testing.assert_array_equal(responses(first) + responses(second), responses(first, second))
    np.testing.assert_array_equal(responses(first), model.responses)
    np.testing.assert_array_equal(responses(first[::-1]), responses(first)[:, ::-1])


def test_several_traverses_are_learned_by_the_same_neurons() -> None:
    """The first traverse decides who learns what; the others are consolidated by the same neurons."""
    config = update(small_config(), {"stretch": 20, "network": {"steps": 128}, "learning": {"epochs": 8, "steps": 200}})
    first, second = encoded(16), encoded(16, noise=1.0)
    seen: list[Progress] = []
    both = train([first, second], config, progress=seen.append)
    assert len(seen) == presentations(config, 16, 2, 8) == 16 * (4 + 2 * 4)
    assert both.training["places_covered"] >= 15
    alone = train([first], config)
    assert both.training["places_covered"] >= alone.training["places_covered"] - 1
    own = alone.neuron_places()[both.neuron_places() >= 0]
    assert np.mean(own == both.neuron_places()[both.neuron_places() >= 0]) > 0.7
