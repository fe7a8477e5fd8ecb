"""The public interface in Python: `train` a model, `load` one, ask a `Localizer` where a robot is, image by image."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lava_vpr import config as settings
from lava_vpr import maps
from lava_vpr import model as model_file
from lava_vpr.backends.asking import Asker, Asking, summed
from lava_vpr.backends.host import HostBackend
from lava_vpr.backends.opening import calibration_of, open_model
from lava_vpr.config import Config
from lava_vpr.encoding import EncodedTraverse, Keep, encode_arrays, encode_views
from lava_vpr.engine.adaptation import Motion
from lava_vpr.engine.threads import cores
from lava_vpr.errors import InputError
from lava_vpr.events.files import is_recording
from lava_vpr.inputs.vectors import Standard
from lava_vpr.matching.answers import Together, accepted, answers_of, least_probability
from lava_vpr.matching.forward_filter import NONE, RADIUS, Belief, ForwardFilter
from lava_vpr.model import Model, prepare
from lava_vpr.positions.frames import XY, Positions
from lava_vpr.training.calibration import calibrated
from lava_vpr.training.loop import train as train_encoded
from lava_vpr.training.standard import fitted, settings_for
from lava_vpr.traverse import Traverse, open_traverse, vector_traverse
from lava_vpr.vectors.source import Vectors, checked_vectors

Images: TypeAlias = "str | Path | Sequence[NDArray[Any]] | NDArray[Any]"
"""A folder, list, video, image or file of vectors; or images in memory, each uint8 (h, w) or (h, w, 3) BGR; or vectors,
one for each image, real numbers (images, values)."""

CANDIDATES = 5
"""Number of candidates that a match names."""


def train(
    *references: Images,
    rates: NDArray[Any] | Sequence[NDArray[Any]] | None = None,
    preset: str = "loihi",
    config: Config | None = None,
    positions: Positions | NDArray[np.float64] | None = None,
    seed: int | None = None,
    threads: int | None = None,
) -> Model:
    """Learn the places of a route.

    Args:
        references: One or more traverses of the same places; image i of each shows place i. Vectors are standardised on
            all of them, and those of more than ``encoder.vector_kept`` values projected on so many.
        rates: Instead of ``references``: what each input responds to each image, real numbers of at least 0, (images,
            inputs), of one traverse or of each of several; they are taken as they are.
        preset: Name of the settings, if no ``config`` is given; recordings of events are learned with
            `lava_vpr.config.for_events` of it.
        config: All settings.
        positions: Where the first traverse's images were taken; an array is x and y in metres, float64 (places, 2).
        seed: Another seed than that of the settings.
        threads: Threads, which do not change the result; None: one a processor.
    Returns:
        The model, with probabilities calibrated; `lava_vpr.model.save` writes it, and so does `Localizer.save`.
    Raises:
        LavaVprError: images or settings cannot be used.
    """
    if bool(references) == (rates is not None):
        raise InputError("there is nothing to learn, or too much; give the images of a route, or rates")
    chosen = settings.preset(preset) if config is None else config
    if config is None and any(isinstance(images, (str, Path)) and is_recording(images) for images in references):
        chosen = settings.for_events(chosen)
    if seed is not None:
        chosen = dataclasses.replace(chosen, seed=seed)
    if rates is not None:
        encoder = dataclasses.replace(chosen.encoder, kind="rates", vector_values=0)
        chosen = dataclasses.replace(chosen, encoder=encoder)
        references = (rates,) if np.ndim(rates[0]) == 1 else tuple(rates)
    opened = [_opened(images, chosen) for images in references]
    traverses = [images for images in opened if isinstance(images, Traverse)]
    if traverses:
        chosen = settings_for(chosen, traverses)
    standard = fitted(chosen, traverses) if len(traverses) == len(opened) else None
    encoded = [seen for images in opened for seen in _encoded(images, chosen, standard)]
    where = Positions(np.asarray(positions, np.float64), XY) if isinstance(positions, np.ndarray) else positions
    jobs = cores() if threads is None else threads
    return calibrated(train_encoded(encoded, chosen, positions=where, standard=standard, jobs=jobs), jobs)


def load(path: str | Path) -> Model:
    """The model in a model file, or in the folder of a deployed bundle.

    Raises:
        ModelFileError: it cannot be used.
    """
    return open_model(path)


def _opened(images: Images, config: Config) -> Traverse | Sequence[NDArray[Any]]:
    """What is on the disk, or vectors, as a traverse; images in memory as they are."""
    if isinstance(images, (str, Path)):
        return open_traverse(images, events=config.events)
    if len(images) and np.ndim(images[0]) == 1:
        rows = images if isinstance(images, np.ndarray) else _stacked(images)
        return vector_traverse("vectors", Vectors(checked_vectors(rows, "vectors")))
    return list(images)


def _stacked(vectors: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Vectors of one length as one array."""
    for number, vector in enumerate(vectors):
        if np.shape(vector) != np.shape(vectors[0]):
            raise InputError(
                f"vector {number} has shape {np.shape(vector)}, the first {np.shape(vectors[0])}; give equal ones"
            )
    return np.stack([np.asarray(vector) for vector in vectors])


def _encoded(
    images: Traverse | Sequence[NDArray[Any]], config: Config, standard: Standard | None
) -> tuple[EncodedTraverse, ...]:
    """A traverse in all views, with all that a model keeps."""
    if isinstance(images, Traverse):
        return encode_views(images, config.encoder, config.views.views, Keep.ALL, None, standard)
    return encode_arrays(list(images), config.encoder, config.views.views, Keep.ALL, None, standard)


@dataclass(frozen=True)
class Candidate:
    """A place that an image may show.

    Attributes:
        place: Its absolute index in the reference traverse.
        name: File name of its reference image.
        score: The decoder's score of the image at this place.
        probability: How likely it is; NaN for all but the first where each image is answered alone.
    """

    place: int
    name: str
    score: float
    probability: float


@dataclass(frozen=True)
class Match:
    """Where an image was taken.

    Attributes:
        place: Absolute index of the best place in the reference traverse, also if it is not accepted; -1: the image
            matches none.
        name: File name of that place's reference image; empty without a place.
        position: Coordinates of that place in ``frame``; None without a place, or where they are not known.
        frame: Frame of the position (`lava_vpr.positions.frames`).
        probability: How likely the robot is there, within ``radius`` places; NaN where that is not known.
        accepted: Whether that is likely enough for the precision that was aimed at.
        radius: See ``probability``: 0 where each image is answered alone.
        off_map: How likely the robot is off the map; NaN where each image is answered alone.
        confidence: How sure the decoder is of this image alone; -inf if the image made no neuron spike.
        candidates: The best places, best first, at most `CANDIDATES`.
        spikes: Spike counts of the neurons, int32 (neurons,).
        stamp: What `Localizer.update` was given.
    """

    place: int
    name: str
    position: tuple[float, float] | None
    frame: str | None
    probability: float
    accepted: bool
    radius: int
    off_map: float
    confidence: float
    candidates: tuple[Candidate, ...]
    spikes: NDArray[np.int32] = field(repr=False)
    stamp: float | None = None


class Localizer:
    """Says where a robot is, image by image, from a map of places.

    It computes in the caller's thread, opens no file after the map is read, and needs no more memory for more images.

    Args:
        model: A model, or the path of a model file or bundle.
        motion: ``any``: the robot drives at any speed, stops and turns; ``forward``: never back; ``none``: each image
            is answered alone.
        adapt: Time constant in images by which neurons' biases follow the images before; None: they do not.
        query_views: Sideways views in which each image is presented, an odd number. With more than one, and motion
            ``none``, probabilities are not known.
        target_precision: Share of the accepted matches that shall be right.
        seed: Seed of the images' spikes; None: the model's.
    Raises:
        LavaVprError: the model cannot be used, or not like this.
    """

    def __init__(
        self,
        model: Model | str | Path,
        motion: str = "any",
        adapt: float | None = None,
        query_views: int = 1,
        *,
        target_precision: float = 0.95,
        seed: int | None = None,
    ) -> None:
        self._asking, self._seed = Asking(query_views, adapt), seed
        self._motion, self._precision = motion, target_precision
        self._backend = HostBackend(1)
        self._use(model if isinstance(model, Model) else load(model))
        self.reset()

    @property
    def model(self) -> Model:
        """The map, with all that was added and without what was removed."""
        return self._model

    def reset(self) -> None:
        """Forget the images so far: the next may be anywhere, on the map or off it."""
        self._asker, self._moving = Asker(self._model, self._asking, self._seed), Motion()
        self._belief, self._begun = Belief.unknown(self._model.places), False

    def update(self, image: NDArray[Any], stamp: float | None = None, odometry: float | None = None) -> Match:
        """Take the next image.

        Args:
            image: uint8 (h, w) grey or (h, w, 3) BGR; or a vector, real numbers (values,), of a map of vectors.
            stamp: When it was taken, in seconds; handed on with the match.
            odometry: Metres driven since the last image, backwards below 0 (or either way, with motion ``any``); None:
                unknown. Needs a map with positions.
        Raises:
            InputError: the image is none, or the odometry cannot be used.
        """
        model = self._model
        seen = encode_arrays([image], model.config.encoder, self._views, standard=model.standard)
        shown = self._asker.presentations(seen)
        counts = summed(self._backend.count_spikes(self._model, shown)[0], self._asking.views)
        scores = self._scores_of(counts)
        alone = answers_of(self._model.config.decoder.default, scores, self._together.calibration)
        confidence = float(alone.confidence[0])
        if self._motion == NONE:
            order = np.argsort(-scores[0], kind="stable")[:CANDIDATES]
            chances = np.full(len(order), np.nan)
            chances[0] = alone.probability[0]
            place, probability, off_map = int(alone.matches[0]), float(alone.probability[0]), math.nan
        else:
            belief = self._followed(scores[0], bool(self._moving.moving(shown.rates[:1])[0]), odometry)
            order = np.argsort(-belief.places, kind="stable")[:CANDIDATES]
            chances = belief.places[order]
            place, off_map = int(order[0]), belief.off_map
            probability = round(belief.near(place), 9)
        answer = alone._replace(matches=np.array([place]), probability=np.array([probability]))
        return Match(
            place=self._index(place),
            name=self._model.place_names[place] if place >= 0 else "",
            position=self._position(place),
            frame=self._model.frame,
            probability=probability,
            accepted=bool(accepted(answer, self._least)[0]),
            radius=0 if self._motion == NONE else RADIUS,
            off_map=off_map,
            confidence=confidence,
            candidates=tuple(
                Candidate(self._index(k), self._model.place_names[k], float(scores[0, k]), float(chance))
                for k, chance in zip(order.tolist(), chances.tolist(), strict=True)
            ),
            spikes=counts[0],
            stamp=stamp,
        )

    def add(
        self,
        images: Images,
        positions: Positions | NDArray[np.float64] | None = None,
        names: Sequence[str] | None = None,
    ) -> None:
        """Learn further places; what was learned stays as it is, and so does what is believed.

        Args:
            images: Images of the new places, in driving order.
            positions: Where they were taken, in the map's frame; needed if the map has positions, and only then.
            names: A name for each of ``images`` in memory.
        Raises:
            LavaVprError: the images or positions do not fit the map.
        """
        frame = self._model.frame or XY
        where = Positions(np.asarray(positions, np.float64), frame) if isinstance(positions, np.ndarray) else positions
        taken: Any = images
        if isinstance(images, (str, Path)):
            taken = _encoded(_opened(images, self._model.config), self._model.config, self._model.standard)
        before = self._belief
        self._use(maps.extend(self._model, taken, names=names, positions=where))
        new = np.zeros(self._model.places - len(before.places))
        self._go_on(Belief(np.concatenate([before.places, new]), before.off_map))

    def remove(self, places: Sequence[int]) -> None:
        """Forget places of the map.

        Args:
            places: Absolute indices, as `Match.place` gives them.
        Raises:
            InputError: the map has no such place, or fewer than two would be left.
        """
        before, kept = self._belief, ~np.isin(self._model.place_indices, np.asarray(places, np.int64))
        self._use(maps.remove(self._model, places))
        left = before.places[kept]
        self._go_on(Belief(left, before.off_map + float(before.places.sum() - left.sum())))

    def save(self, path: str | Path) -> None:
        """Write the map to a model file; it appears complete or not at all.

        Raises:
            ModelFileError: it cannot be written.
        """
        model_file.save(self._model, Path(path))

    def _use(self, model: Model) -> None:
        """Take a model, and make the tables that every image needs."""
        self._asking.check(model)
        known = None if self._asking.views > 1 else calibration_of(model)
        self._model = model if known is None else dataclasses.replace(model, calibration=known.samples)
        self._together = Together(motion=self._motion, calibration=known, along=_along(model.whereabouts))
        self._least = least_probability(self._together, self._precision)
        self._views, self._scores_of = self._asking.of(model), prepare(model)

    def _go_on(self, belief: Belief) -> None:
        """Go on with a changed map and this belief."""
        begun = self._begun
        self.reset()
        self._belief, self._begun = belief, begun

    def _followed(self, scores: NDArray[np.float64], moving: bool, odometry: float | None) -> Belief:
        """What is believed once an image with these scores (places,) is seen."""
        follower = ForwardFilter(self._belief, self._motion, self._together.along)
        follower = follower.update(scores, moving=moving, odometry=odometry, first=not self._begun)
        self._belief, self._begun = follower.belief, True
        return self._belief

    def _index(self, place: int) -> int:
        """The absolute index of a place; -1 for none."""
        return int(self._model.place_indices[place]) if place >= 0 else -1

    def _position(self, place: int) -> tuple[float, float] | None:
        """The coordinates of a place, if there are any."""
        if place < 0 or self._model.positions is None:
            return None
        first, second = self._model.positions[place].tolist()
        return float(first), float(second)


def _along(places: Positions | None) -> NDArray[np.float64] | None:
    """Metres along the route of each place, float64 (places,); None where positions are not known."""
    if places is None:
        return None
    steps = np.sqrt((np.diff(places.points(), axis=0) ** 2).sum(axis=1))
    return np.concatenate([[0.0], np.cumsum(steps)])
