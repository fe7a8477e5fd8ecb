"""The public interface for a robot: `load` a model, and locate it with a `Localizer`, image by image."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lava_vpr import maps, model as model_file
from lava_vpr.backends.asking import MODELS, Asker, Asking, calibration_of, open_model, summed
from lava_vpr.backends.interface import HostBackend
from lava_vpr.encoding import Keep, encode_arrays, encode_views, image_traverse
from lava_vpr.engine.adaptation import Motion
from lava_vpr.engine.gains import Season
from lava_vpr.engine.inference.direct import strengths
from lava_vpr.errors import ConfigError
from lava_vpr.framing import NO_CROP, of_references
from lava_vpr.inputs.doubts import Doubts
from lava_vpr.inputs.encoder import INPUTS
from lava_vpr.matches import Match, likeness_of, matches_of
from lava_vpr.matching.answers import Answerer, Together, accepted, least_probability
from lava_vpr.matching.beliefs import Belief
from lava_vpr.matching.forward_filter import NONE
from lava_vpr.matching.probability import HALF
from lava_vpr.model import Model, prepare
from lava_vpr.positions.frames import Positions
from lava_vpr.season.file import load as load_season, save as save_season
from lava_vpr.settings.arguments import check_arguments
from lava_vpr.traverse import open_traverse

if TYPE_CHECKING:
    from lava_vpr.learning.references import Images

CANDIDATES = 5
"""Number of candidates that a match names."""


def load(path: str | Path) -> Model:
    """Read the model in a model file, or in the folder of a deployed bundle.

    Raises:
        LavaVprError: it cannot be used.
    """
    check_arguments("path", path=path)
    return open_model(path)


class Localizer:
    """Locates a robot, image by image, on a map of places.

    It computes in the caller's thread, opens no file after the map is read, and its memory does not grow with the
    number of images. A deep copy, or a pickled one, continues from the same state. Only one thread at a time may use
    it: each call changes the belief, and `add` and `remove` change the map. Threads may share a `Model`, which never
    changes; give each thread its own localizer.

    Args:
        model: A model, or the path of a model file or bundle.
        motion: ``any``: the robot drives in both directions, stops and turns; ``forward``: only forward; ``none``: each
            image is answered alone.
        adapt: Time constant, in images, with which neurons' biases adapt to the previous images; ``model``: that of the
            model's settings (``network.adapt``), but no adaptation where each image is answered alone; None: no
            adaptation.
        query_views: Sideways views in which each image is presented, an odd number. With more than one, and motion
            ``none``, probabilities are not known and no match is accepted.
        target_precision: Share of the accepted matches that should be correct; None: 0.95.
        off_map: Share of the images that is assumed to be off the map, at least 0 and below 1.
        seed: Seed of the images' spikes; None: the model's.
        crop: ``auto``: bars at the edges of images are cropped, or masked where they cover a part of it; or ``none``.
        learn: Whether sure answers teach the gains of inputs, so that inputs that survive the season count more.
        season: Season learned before, or the path of its file; None: none.
    Raises:
        LavaVprError: the model cannot be used, or not with these arguments.
    """

    def __init__(
        self,
        model: Model | str | Path,
        motion: str = "any",
        adapt: float | str | None = MODELS,
        query_views: int = 1,
        *,
        target_precision: float | None = None,
        off_map: float = HALF,
        seed: int | None = None,
        crop: str = NO_CROP,
        learn: bool = False,
        season: Season | str | Path | None = None,
    ) -> None:
        check_arguments(
            "motion query_views off_map crop learn",
            motion=motion,
            adapt=adapt,
            query_views=query_views,
            target_precision=target_precision,
            off_map=off_map,
            seed=seed,
            crop=crop,
            learn=learn,
        )
        if not (season is None or isinstance(season, Season)):
            check_arguments(path=season)
            season = load_season(season)
        if not isinstance(model, Model):
            check_arguments("model", model=model)
        self._asking = dataclasses.replace(Asking.wanted(query_views, adapt, crop), learn=learn, season=season)
        self._seed = seed
        self._motion, self._precision, self._off_map = motion, target_precision, off_map
        self._backend, self._calls = HostBackend(), 0
        self._use(model if isinstance(model, Model) else load(model))
        self._begin()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_scores_of"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._scores_of = prepare(self._model)

    @property
    def model(self) -> Model:
        """The map, with added places and without removed ones."""
        return self._model

    @property
    def belief(self) -> Belief | None:
        """Probability of each place, and of being off the map, after the images so far; None with motion ``none``."""
        return None if self._answerer.filter is None else Belief.of(self._answerer.filter)

    @property
    def scores(self) -> NDArray[np.float64] | None:
        """The decoder's score of the last image alone at each place, higher is better, float64 (places,).

        None before the first image, and after a change of the map.
        """
        return self._scores

    @property
    def season(self) -> Season | None:
        """The season learned so far; None without ``learn`` and ``season``."""
        return self._asker.season

    def reset(self) -> None:
        """Forget the images so far: the next may be anywhere, on the map or off it.

        With ``learn``, the season that they taught stays, with their mean; `save_season` writes it.
        """
        self._asking = dataclasses.replace(self._asking, season=self.season)
        self._begin()

    def _begin(self) -> None:
        """Ask and answer from the first image on."""
        self._scores: NDArray[np.float64] | None = None
        self._asker, self._moving = Asker(self._model, self._asking, self._seed), Motion()
        self._framing = self._asking.framing(self._model)
        self._doubts = Doubts(self._likeness, framed=self._framing is not None)
        self._answerer = Answerer.of(self._model.config.decoder.default, self._model.places, self._together)

    def update(
        self,
        image: NDArray[Any],
        stamp: float | None = None,
        odometry: float | None = None,
        *,
        name: str | None = None,
    ) -> Match:
        """Locate the next image; an image that is refused changes nothing.

        Args:
            image: uint8 (h, w) grey or (h, w, 3) BGR; or a vector, real numbers (values,), of a map of vectors.
            stamp: Time at which it was taken, in seconds: after a longer pause than usual the robot may have driven
                further. NaN is ignored; the match reports other faults of the time.
            odometry: Metres driven since the last image, negative if backwards (or in either direction, with motion
                ``any``); None: unknown. Needs a map with positions. With odometry, a stuck camera is reported.
            name: Name of the image in messages; None: the number of the call, from 0.
        Raises:
            InputError: it is not an image, or the odometry cannot be used.
        """
        model, word = self._model, INPUTS[self._model.config.encoder.kind].sees
        how: Any = {"names": [f"{word} {self._calls}" if name is None else name], "standard": model.standard}
        self._calls += 1
        check_arguments(stamp=stamp, odometry=odometry, name=name)
        if odometry is not None and self._answerer.filter is not None:
            self._answerer.filter.check_odometry(odometry)
        seen = encode_arrays([image], model.config.encoder, self._views, **how, framing=self._framing)
        shown = self._asker.presentations(seen)
        counts = summed(self._backend.count_spikes(self._asker.model, shown)[0], self._asking.views)
        rates = strengths(shown.seen[:1], model.config.encoder.direct is not None)
        moving = None if self._motion == NONE else self._moving.moving(rates)
        stamps = None if stamp is None else np.array([stamp], np.float64)
        scores = self._scores_of(counts)
        self._answerer, answers = self._answerer.step(scores, moving, odometry, stamps)
        signs = [self._doubts.sign(seen[0].activity[0], stamp, odometry)]
        self._asker.learn(answers, signs)
        self._scores = scores[0]
        good = accepted(answers, self._least)
        (match,) = matches_of(
            self._model, answers, good, counts, radius=self._together.radius, top=CANDIDATES, stamps=stamps, signs=signs
        )
        return match

    def add(
        self,
        images: Images,
        positions: Positions | ArrayLike | None = None,
        names: Sequence[str] | None = None,
        *,
        allow_duplicates: bool = False,
    ) -> None:
        """Add places to the map; neither what was learned before nor the belief changes.

        Args:
            images: Images of the new places, in driving order.
            positions: Where they were taken, in the map's frame; required if the map has positions, and refused
                otherwise.
            names: A name for each of ``images`` in memory.
            allow_duplicates: Whether to accept images that the map already has.
        Raises:
            LavaVprError: the images or positions do not fit the map, or are duplicates that are not allowed.
        """
        check_arguments("images allow_duplicates", images=images, names=names, allow_duplicates=allow_duplicates)
        taken: Any = images
        encoder, views, crop = self._model.config.encoder, self._model.config.views.views, self._asking.crop
        if isinstance(images, (str, Path)):
            opened = open_traverse(images, events=self._model.config.events)
            framing = of_references(opened, encoder, crop)
            taken = encode_views(opened, encoder, views, Keep.ALL, None, self._model.standard, framing=framing)
        elif crop != NO_CROP:
            framing = of_references(image_traverse(list(images)), encoder, crop)
            taken, names = encode_arrays(list(images), encoder, views, Keep.ALL, names, framing=framing), None
        known = self._model.places
        how: Any = {"names": names, "positions": positions, "allow_duplicates": allow_duplicates}
        changed = maps.extend(self._model, taken, **how)
        source = np.arange(changed.places)
        self._go_on(changed, np.where(source < known, source, -1))

    def remove(self, places: Sequence[int]) -> None:
        """Remove places from the map.

        Args:
            places: Absolute indices, as `Match.place` gives them.
        Raises:
            InputError: the map has no such place, or fewer than two places would remain.
        """
        changed = maps.remove(self._model, places)
        self._go_on(changed, np.flatnonzero(np.isin(self._model.place_indices, changed.place_indices)))

    def save(self, path: str | Path) -> None:
        """Write the map to a model file; it appears complete or not at all.

        Raises:
            ModelFileError: it cannot be written.
        """
        check_arguments("path", path=path)
        model_file.save(self._model, Path(path))

    def save_season(self, path: str | Path) -> None:
        """Write the season learned so far to a file; it appears complete or not at all.

        Raises:
            ConfigError: there is no season, without ``learn`` and ``season``.
            ModelFileError: it cannot be written.
        """
        check_arguments("path", path=path)
        if self.season is None:
            raise ConfigError("there is no season to save; give learn=True, or a season")
        save_season(self.season, Path(path))

    def _use(self, model: Model) -> None:
        """Take a model, and make the tables that every image needs."""
        self._asking = self._asking.tracking(model, self._motion)
        self._asking.check(model)
        known = None if self._asking.views > 1 else calibration_of(model)
        self._model = model if known is None else dataclasses.replace(model, calibration=known.samples)
        self._together = Together(
            motion=self._motion, calibration=known, off_map=self._off_map, along=_along(model.whereabouts)
        )
        self._asking.check_together(self._together)
        self._least = least_probability(self._together, self._precision)
        self._views, self._scores_of, self._likeness = self._asking.of(model), prepare(model), likeness_of(model)

    def _go_on(self, model: Model, source: NDArray[np.int64]) -> None:
        """Follow on with a changed map, whose places were at ``source`` in the one before; -1: nowhere."""
        before, doubts = self._answerer.filter, self._doubts
        self._use(model)
        self.reset()
        self._doubts, doubts.likeness = doubts, self._likeness
        if before is not None:
            calibration, along = self._together.calibration, self._together.along
            following = dataclasses.replace(before.remapped(source, along), calibration=calibration)
            self._answerer = dataclasses.replace(self._answerer, filter=following)


def _along(places: Positions | None) -> NDArray[np.float64] | None:
    """Metres along the route of each place, float64 (places,); None where positions are not known."""
    if places is None:
        return None
    steps = np.sqrt((np.diff(places.points(), axis=0) ** 2).sum(axis=1))
    return np.concatenate([[0.0], np.cumsum(steps)])
