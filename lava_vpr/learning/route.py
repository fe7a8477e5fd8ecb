"""The one way from references to a model: `train` for Python, `Training` for commands, studies and benchmarks.

References are opened and their places chosen; the settings are made to fit what they are, with the standard
that vectors are measured by; they are encoded, learned, and the probabilities calibrated.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lava_vpr import config as presets
from lava_vpr.cluster.connection import connected
from lava_vpr.cluster.tasks import ONE_THREAD, Pool
from lava_vpr.config import Config, for_events
from lava_vpr.configfile import read_toml, update
from lava_vpr.datasets.selecting import Benchmark, Selection
from lava_vpr.engine.presentations import cores
from lava_vpr.errors import InputError, UsageError, shown
from lava_vpr.events.files import is_recording
from lava_vpr.framing import NO_CROP
from lava_vpr.inputs.windows import EventsConfig
from lava_vpr.kernelcache import seconds_compiling
from lava_vpr.learning.behind import compared
from lava_vpr.learning.references import Images, Places, each, encode_route, in_memory, located_each
from lava_vpr.model import Model
from lava_vpr.positions.track import MOST_GAP_S
from lava_vpr.settings.arguments import check_arguments
from lava_vpr.training.checkpoint import check_resume, remove_checkpoint
from lava_vpr.training.loop import check_size, train as train_encoded
from lava_vpr.training.measuring import calibrated
from lava_vpr.training.preparing import check_asked, check_references, choose_places, fitted, settings_for
from lava_vpr.training.stretches import UNSEEN, Monitor, learning_bar
from lava_vpr.training.trainers import rule_settings
from lava_vpr.traverse import Traverse, open_traverses, readable, unread_exif

_NOTES = logging.getLogger("lava_vpr")
SETTINGS = {
    "input": ("encoder", "kind"),
    "epochs": ("learning", "epochs"),
    "neurons": ("network", "neurons"),
    "weight_bits": ("network", "weight_bits"),
    "views": ("views", "shifts"),
    "window_ms": ("events", "window_ms"),
    "window_events": ("events", "window_events"),
    "seed": ("seed",),
    "stretch": ("stretch",),
    "learning": (),
    "events": (),
}
"""Single settings by the name that `train` and the command line give them, and where each stands. ``learning`` names a
row of `lava_vpr.training.trainers.LEARNING`; ``events``: the references are images of events."""


def train(
    *references: Images,
    rates: NDArray[Any] | Sequence[NDArray[Any]] | None = None,
    preset: str | None = None,
    config: Config | str | Path | None = None,
    places: tuple[int, int] | None = None,
    every: float = 1.0,
    skip_unreadable: bool = False,
    dataset: str | None = None,
    section: int | None = None,
    positions: Places = (),
    stamps: str | Sequence[str] = (),
    gap: float = MOST_GAP_S,
    spacing: float | None = None,
    keyframes: float | None = None,
    parts: Sequence[int] = (),
    standard: Model | str | Path | None = None,
    threads: int | None = None,
    cluster: str | None = None,
    checkpoint: str | Path | None = None,
    resume: bool = False,
    crop: str = NO_CROP,
    progress: Monitor = UNSEEN,
    **settings: Any,
) -> Model:
    """Learn the places of a route, as ``lava-vpr train`` does.

    Args:
        references: One or more traverses of the same places; image i of each shows place i. Vectors are standardised on
            all of them, and those of more than ``encoder.vector_kept`` values are projected on that many.
        rates: Instead of ``references``: what each input responds to each image, real numbers of at least 0, (images,
            inputs), of one traverse or of each of several; they are used unchanged.
        preset: Name of the settings to start from; None: ``loihi``. Recordings of events are learned with
            `lava_vpr.config.for_events` of it.
        config: All settings; or a file of settings in TOML, which changes those of the preset.
        places: Images A..B-1 of each traverse.
        every: Seconds between two images of a video, bag or recording of events.
        dataset, section: The one reference is the folder of this benchmark dataset, and one of its sections, from 1.
        positions: Where images were taken, of the first traverse or of each: a file; ``exif``, from the photos; or an
            array, x and y in metres, float64 (images, 2), of the images in use.
        skip_unreadable: Skip image files that cannot be read, and note which; the others keep their absolute indices,
            and traverses in step all skip the same images.
        stamps: CSV file with the times of the images, or when a video begins, of the first traverse or of each.
        gap: Longest gap in seconds between two positions in which an image is placed by its time.
        spacing: Metres between two places that are learned; needs positions.
        keyframes: Learn only images whose input changed by this much since the previous place: 1 - cosine, above 0 to
            1.
        parts: Numbers of places of consecutive parts of the route, each cut into stretches separately.
        standard: Model whose mean, scale and projection vectors use, so that both can be merged.
        threads: Number of threads, which does not change the result; None: one for each processor.
        cluster: ``tcp://HOST:PORT`` of a Dask scheduler whose workers learn instead.
        checkpoint: File for the progress while it learns; removed at the end.
        resume: Whether to continue from ``checkpoint``.
        crop: ``auto``: bars that the images of a traverse have in common are cropped, or masked where they cover a
            part of them (`lava_vpr.framing`); or ``none``.
        progress: Receives progress and notes.
        settings: Single settings, of `SETTINGS`: ``seed=1``, ``epochs=4``, ``learning="template"``.
    Returns:
        The model, with probabilities calibrated; `lava_vpr.model.save` writes it, and so does `Localizer.save`.
    Raises:
        LavaVprError: images or settings cannot be used.
    """
    arguments: dict[str, Any] = {
        "preset": preset,
        "places": places,
        "every": every,
        "skip_unreadable": skip_unreadable,
        "dataset": dataset,
        "section": section,
        "stamps": stamps,
        "gap": gap,
        "spacing": spacing,
        "keyframes": keyframes,
        "parts": parts,
        "checkpoint": checkpoint,
        "resume": resume,
        "crop": crop,
    }
    check_arguments(
        "every skip_unreadable stamps gap parts resume crop", rates=rates, threads=threads, cluster=cluster, **arguments
    )
    if bool(references) == (rates is not None):
        raise InputError("there is nothing to learn, or too much; give the images of a route, or rates")
    if rates is not None:
        settings["input"] = "rates"
        references = (rates,) if np.ndim(rates[0]) == 1 else tuple(rates)
    check_arguments(references=references)
    check_arguments(config=None if isinstance(config, Config) else config)
    check_arguments(standard=None if isinstance(standard, Model) else standard)
    arguments["checkpoint"] = None if checkpoint is None else Path(checkpoint)
    training = Training.of(references, config=config, positions=positions, standard=standard, **arguments, **settings)
    with connected(cluster) as workers:
        model = training.learn(Pool(threads or cores(), workers), progress).model
    if training.checkpoint is not None:
        remove_checkpoint(training.checkpoint)
    return model


class Learned(NamedTuple):
    """A model, seconds that learning and calibrating took, without reading, and seconds of compiling, for all of it."""

    model: Model
    seconds: float
    compiling: float

    @property
    def took(self) -> str:
        """Both, for people."""
        first = f" (and {self.compiling:.0f} s compiling, in the first run alone)" if self.compiling >= 1 else ""
        return f"{self.seconds:.1f} s{first}"


@dataclass(frozen=True)
class Training:
    """A training that is to be done: the arguments of `train`, by the same names.

    Raises:
        UsageError: two of them exclude each other, or one lacks another.
    """

    references: Sequence[Images]
    settings: Mapping[str, Any] = field(default_factory=dict)
    preset: str | None = None
    config: Config | str | Path | None = None
    places: tuple[int, int] | None = None
    every: float = 1.0
    skip_unreadable: bool = False
    dataset: str | None = None
    section: int | None = None
    positions: Places = ()
    stamps: str | Sequence[str] = ()
    gap: float = MOST_GAP_S
    spacing: float | None = None
    keyframes: float | None = None
    parts: Sequence[int] = ()
    standard: Model | str | Path | None = None
    checkpoint: Path | None = None
    resume: bool = False
    crop: str = NO_CROP

    @classmethod
    def of(cls, references: Sequence[Images], **arguments: Any) -> Training:
        """A training with ``arguments`` of `train`, single `SETTINGS` among them; a setting of None is none."""
        single = {name: arguments.pop(name) for name in SETTINGS if name in arguments}
        return cls(references, {name: value for name, value in single.items() if value is not None}, **arguments)

    def __post_init__(self) -> None:
        if {"window_ms", "window_events"} <= self.settings.keys():
            raise UsageError("--window-ms and --window-events both say how long a window is; give one of them")
        if self.spacing is not None and self.keyframes is not None:
            raise UsageError("--spacing and --keyframes both say which images become places; give one of them")
        if self.resume and self.checkpoint is None:
            raise UsageError("there is nowhere to resume from; name the checkpoint")

    @cached_property
    def start(self) -> Config:
        """The settings that the preset, then the file, then single ones decide, whatever the references are.

        Raises:
            ConfigError: a setting that is unknown, out of range, or contradicts another.
        """
        recorded = not isinstance(self.config, Config) and any(map(is_recording, self._paths))
        single = {**self.settings, "events": self.settings.get("events") or recorded}
        return settings_of(self.preset, self.config, single)

    @cached_property
    def selection(self) -> Selection:
        """Where the traverses lie on disk.

        Raises:
            InputError: a benchmark dataset is not where it should be.
        """
        chosen = Benchmark(self.dataset, self.section)
        excluded = {"places": self.places, "keyframes": self.keyframes, "skip_unreadable": self.skip_unreadable}
        return chosen.learned(self._paths, self.every, **excluded)

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that are read beside the references."""
        named = (self.config, self.standard, *each(self.positions), *each(self.stamps))
        return tuple(Path(file) for file in named if isinstance(file, (str, Path)))

    @property
    def _paths(self) -> tuple[str, ...]:
        """The references that lie on disk."""
        return tuple(str(source) for source in self.references if isinstance(source, (str, Path)))

    def learn(
        self,
        pool: Pool = ONE_THREAD,
        monitor: Monitor = UNSEEN,
        opened: Callable[[Iterable[str]], object] = lambda paths: None,
    ) -> Learned:
        """Do it.

        Args:
            pool: Who learns.
            monitor: Shows what is being done.
            opened: Takes the paths of all images before any work is done.
        Raises:
            LavaVprError: as `train`.
        """
        compiled = seconds_compiling()
        if self.checkpoint is not None:
            check_resume(self.checkpoint, self.resume)
        whole = self._opened(self.start.events)
        opened(path for traverse in whole for path in traverse.paths)
        chosen, config = self._chosen(whole, monitor)
        stretches = check_size(len(chosen[0]), config, len(chosen), self.parts)
        config, standard, references = encode_route(
            chosen, config, monitor, self.standard, threads=pool.threads, crop=self.crop
        )
        started = time.perf_counter() - seconds_compiling()
        try:
            with learning_bar(
                monitor, stretches, config, len(chosen), here=pool.here, checkpoint=self.checkpoint
            ) as bar:
                model = train_encoded(
                    references,
                    config,
                    route_images=len(whole[0]),
                    positions=chosen[0].positions,
                    standard=standard,
                    parts=self.parts,
                    pool=pool,
                    checkpoint=self.checkpoint,
                    resume=self.resume,
                    progress=bar.show,
                    resumed=bar.resumed,
                )
        except KeyboardInterrupt:
            if self.checkpoint is not None and self.checkpoint.exists():
                monitor.line(f"progress is kept in {shown(self.checkpoint)}; go on with --resume")
            raise
        with monitor.stage("calibrating probabilities"):
            model = calibrated(model, pool)
        seconds = time.perf_counter() - seconds_compiling() - started
        compiled = seconds_compiling() - compiled
        with monitor.stage("comparing with templates"):
            found = compared(model, pool)
        if found is not None and found.said is not None:
            _NOTES.warning(found.said)
        return Learned(model, seconds, compiled)

    def _opened(self, events: EventsConfig) -> list[Traverse]:
        """Each reference as a traverse, whole."""
        stored = iter(open_traverses(self.selection.sources, every=self.selection.every, events=events))
        if self.dataset is not None:
            return list(stored)
        return [next(stored) if isinstance(images, (str, Path)) else in_memory(images) for images in self.references]

    def _chosen(self, whole: Sequence[Traverse], monitor: Monitor) -> tuple[list[Traverse], Config]:
        """The images of each traverse that become places, and settings for what they are."""
        ranges = self.selection.sampled(whole, self.places)
        if self.skip_unreadable:
            with monitor.stage("looking for images that cannot be read"):
                ranges = readable(ranges, each(self.positions))
        if "input" in self.settings:
            check_asked(ranges, self.start)
        config = settings_for(self.start, ranges)
        ranges = located_each(ranges, [len(traverse) for traverse in whole], self.positions, self.stamps, self.gap)
        first, spacing = ranges[0], self.selection.spacing(self.spacing, ranges)
        if unread_exif(first):
            monitor.line(
                f"note: the photos of {shown(first.source)} say where they were taken, which is not used; with "
                "--positions exif the map knows where its places are, and queries may come in any order"
            )
        if self.keyframes is None:
            chosen = choose_places(ranges, config.encoder, spacing=spacing)
        else:
            with monitor.bar(f"looking for places in {first.source}", len(first)) as advance:
                chosen = choose_places(
                    ranges,
                    config.encoder,
                    standard=fitted(config, ranges),
                    change=self.keyframes,
                    progress=lambda read: advance(read, ""),
                )
        if len(chosen[0]) < len(first):
            monitor.line(f"note: {len(chosen[0])} of {len(first)} images of {shown(first.source)} become places")
        chosen = self.selection.of_section(chosen)
        on_disk = len(self._paths) == len(self.references)
        check_references([len(traverse) for traverse in chosen], self.selection.sources if on_disk else None)
        return chosen, config


def settings_of(preset: str | None, config: Config | str | Path | None, single: Mapping[str, Any]) -> Config:
    """The settings that a preset, then all settings or a file of some, then ``single`` ones (`SETTINGS`) decide.

    Raises:
        ConfigError: a setting that is unknown, out of range, or contradicts another.
    """
    chosen = config if isinstance(config, Config) else presets.preset(preset or "loihi")
    if isinstance(config, (str, Path)):
        chosen = read_toml(Path(config), chosen if preset else None)
    if single.get("events"):
        chosen = for_events(chosen)
    changes: dict[str, Any] = {}
    if "learning" in single:
        changes["learning"] = rule_settings(single["learning"], chosen)
    for name, value in single.items():
        match SETTINGS[name]:
            case (section, key):
                changes.setdefault(section, {})[key] = value
            case (key,):
                changes[key] = value
    return update(chosen, changes)
