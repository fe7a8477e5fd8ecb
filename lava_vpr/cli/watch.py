"""``lava-vpr watch``."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import click

from lava_vpr.backends.asking import MODELS, Asking
from lava_vpr.cli.common import (
    PATH,
    Parsed,
    motion_option,
    off_map_option,
    precision_option,
    seed_type,
    stderr,
)
from lava_vpr.cli.nouns import Learning, OneSource, asking_options, every_option, learning_options, refuse_swapped
from lava_vpr.cli.outputs import Outputs, write_stdout
from lava_vpr.cli.show.headings import IMAGES, OUTPUT, under
from lava_vpr.cli.show.matches import Notes
from lava_vpr.errors import InputError, brief
from lava_vpr.localizer import Localizer
from lava_vpr.readers import open_source
from lava_vpr.show.numbers import counted
from lava_vpr.storage.tables import json_line
from lava_vpr.watch.watching import PORT, Recent, live_page, watch as watch_images


def port_number(text: str) -> int:
    """A port of this machine; `ValueError`: the text is none."""
    if not (text.isascii() and text.isdigit() and len(text) <= 5 and int(text) < 1 << 16):
        raise ValueError(f"{brief(text)} is no port (0 to 65535); put --page behind MODEL and SOURCE")
    return int(text)


@click.command(cls=OneSource)
@click.argument("model_path", metavar="MODEL", type=PATH)
@click.argument("source", type=str)
@motion_option("any", "since a robot sends one image after another")
@asking_options
@learning_options("File with the season; with --learn it need not exist, and is written at the end.")
@precision_option
@off_map_option
@every_option
@under(
    IMAGES,
    click.option(
        "--existing/--no-existing",
        default=True,
        show_default=True,
        help="Also take the images that are in the folder at the start.",
    ),
    click.option(
        "--topic", default=None, metavar="/NAME", help="Topic of a ROS bag (default: the only one with images)."
    ),
)
@under(
    OUTPUT,
    click.option(
        "--page",
        "port",
        type=Parsed("port", port_number),
        is_flag=False,
        flag_value=str(PORT),
        default=None,
        metavar="[PORT]",
        help=f"Serve a live page on 127.0.0.1, by default at port {PORT} (0: any free port).",
    ),
)
@click.option("--stop-after", type=click.IntRange(min=1), default=None, metavar="N", help="End after N answers.")
@click.option("--seed", type=seed_type, default=None, help="Seed of the images' spikes (default: the model's).")
def watch(
    model_path: Path,
    source: str,
    motion: str,
    asking: Asking,
    learning: Learning,
    target_precision: float | None,
    off_map: float,
    every: float,
    existing: bool,
    topic: str | None,
    port: int | None,
    stop_after: int | None,
    seed: int | None,
) -> None:
    """Report which place of MODEL each image of SOURCE shows, as it comes: a line of JSON on standard output.

    SOURCE is a folder that images are written to; a video; a camera (camera:0, /dev/video0 or rtsp://...); a ROS bag; a
    recording of events; -, which reads paths of images from standard input, one a line; or events:346x260, which reads
    events of a sensor of that size from there. Lists and single images work, too.

    An image of a folder is taken once it is complete; one that still cannot be read 5 seconds after its last change is
    skipped. Images that cannot be read are reported on stderr, with a count, and skipped. Ctrl-C ends the command; so
    does the end of SOURCE, unless there is a live page.
    """
    refuse_swapped(model_path, source)
    adapt, known = MODELS if asking.tracked_adapt else asking.adapt, _known(learning, model_path, source)
    how: dict[str, Any] = {"target_precision": target_precision, "off_map": off_map, "seed": seed, "crop": asking.crop}
    localizer = Localizer(model_path, motion, adapt, asking.views, **how, learn=learning.learn, season=known)
    recent, notes, events = Recent(localizer.model), Notes(), localizer.model.config.events
    found = open_source(source, every=every, topic=topic, events=events, live=True, existing=existing)
    refused = partial(_refuse, recent)
    with _kept(localizer, learning), _served(localizer, source, recent, port):
        for watched in islice(watch_images(localizer, found.frames(), refused), stop_after):
            write_stdout(json_line(watched.values()))
            recent.add(watched)
            notes.take(watched.index, watched.match)
        _sum_up(recent, stays=port is not None and recent.said["answered"] != stop_after)


def _known(learning: Learning, model_path: Path, source: str) -> Path | None:
    """The season to begin with: one that is to be written need not be there yet."""
    season = learning.season
    if season is not None and learning.learn:
        Outputs((season,), model=model_path, images=(source,))
        return season if season.exists() else None
    return season


def _refuse(recent: Recent, index: int, why: InputError) -> None:
    """Tell of an image that is left out."""
    recent.refuse()
    stderr.print(f"warning: image {index} is left out ({recent.said['refused']} so far): {why}")


def _sum_up(recent: Recent, *, stays: bool) -> None:
    """Tell what became of the images; where the page ``stays``, let it be looked at until Ctrl-C."""
    said = recent.said
    stderr.print(
        f"note: {counted(said['answered'], 'image')}, {said['recognised']} accepted, {said['refused']} left out"
    )
    if recent.unfollowed.said is not None:
        stderr.print(f"warning: {recent.unfollowed.said}")
    if stays:
        recent.end()
        stderr.print("note: the source has ended; the page stays until Ctrl-C")
    while stays:
        signal.pause()


@contextmanager
def _kept(localizer: Localizer, learning: Learning) -> Iterator[None]:
    """Write what was learned at the end, however that comes, if there is a file for it."""
    try:
        yield
    finally:
        if learning.learn and learning.season is not None:
            localizer.save_season(learning.season)


@contextmanager
def _served(localizer: Localizer, source: str, recent: Recent, port: int | None) -> Iterator[None]:
    """The live page, if one is asked for; its address is reported on stderr."""
    if port is None:
        yield
        return
    with live_page(localizer.model, source, recent, port) as address:
        stderr.print(f"note: the page is at {address}")
        yield
