"""The command line: each command parses, calls one function and prints.

Exit codes: 0 done, 1 the data or the result is at fault (the message says which file, what, and the remedy), 2 wrong
usage.
"""

from __future__ import annotations

import click

from lava_vpr import __version__
from lava_vpr.cli.group import LazyGroup

COMMANDS = {
    "demo": ("lava_vpr.cli.demo", "demo", "Learn and recognise a synthetic route, and write a report."),
    "synth": ("lava_vpr.cli.demo", "synth", "Draw a synthetic route in summer and winter."),
    "train": ("lava_vpr.cli.train", "train", "Learn the places of a route."),
    "extend": ("lava_vpr.cli.models.commands", "extend", "Add places to a model."),
    "remove": ("lava_vpr.cli.models.commands", "remove", "Remove places from a model."),
    "merge": ("lava_vpr.cli.models.commands", "merge", "Join models into one."),
    "eval": ("lava_vpr.cli.evaluate", "evaluate", "Recognise images of known places: recall, precision, baselines."),
    "query": ("lava_vpr.cli.query", "query", "Report which place each image shows."),
    "watch": ("lava_vpr.cli.watch", "watch", "Report where a robot is, image by image."),
    "season": (
        "lava_vpr.cli.models.season",
        "season",
        "Describe, draw, save, apply or forget a learned season.",
    ),
    "verify": ("lava_vpr.cli.verify", "verify", "Compare every spike on every backend."),
    "fit": ("lava_vpr.cli.fit", "fit", "Report what fits on a board, and what each core holds."),
    "deploy": ("lava_vpr.cli.deploy", "deploy", "Write everything that a board needs to run a model."),
    "export": (
        "lava_vpr.cli.models.commands",
        "export",
        "Write a model's network in a format that other programs read.",
    ),
    "import": ("lava_vpr.cli.models.commands", "import_model", "Make a model from a network in another format."),
    "bench": ("lava_vpr.cli.bench", "bench", "Measure what a query costs: recall, time, memory, energy."),
    "datasets": (
        "lava_vpr.cli.published.datasets",
        "datasets",
        "Describe the benchmark datasets, and check one.",
    ),
    "protocol": (
        "lava_vpr.cli.published.protocol",
        "protocol",
        "Run a protocol of the field, and print the published figures of others, too.",
    ),
    "study": ("lava_vpr.cli.study", "study", "Measure what one setting does to recall and cost, with several seeds."),
    "paper-table": (
        "lava_vpr.cli.published.paper_table",
        "paper_table",
        "Compute the paper's table again, and print both.",
    ),
    "doctor": ("lava_vpr.cli.doctor", "doctor", "Report what is installed and what can run."),
}


@click.group(
    cls=LazyGroup,
    table=COMMANDS,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.version_option(__version__, prog_name="lava-vpr")
def main() -> None:
    """Visual place recognition with spiking networks for Intel's Loihi.

    A route is learned from a folder of images; later, in another season or light, a query image is recognised.

    \b
    lava-vpr demo                                      see it work on a built-in synthetic world
    lava-vpr train SUMMER/ -o route.lvpr               learn a route
    lava-vpr extend route.lvpr MORE/                   add further places to it
    lava-vpr eval route.lvpr WINTER/ --report report   recall, precision, plots
    lava-vpr query route.lvpr TODAY/ -o matches.csv    where was each image taken?
    lava-vpr watch route.lvpr FRAMES/ --page           where is the robot now? lines, and a live page
    lava-vpr verify route.lvpr WINTER/                 the same spikes in Lava as on the host?
    lava-vpr fit route.lvpr --target kapoho-bay        what would each core hold?
    lava-vpr deploy route.lvpr --target loihi2 -o out  write all that a board needs
    lava-vpr bench route.lvpr WINTER/ --report report  what does a query cost?
    lava-vpr study places SUMMER/ --query WINTER/      what does the number of places do?
    lava-vpr export route.lvpr -o net.nir              the network for other simulators and chips
    """
