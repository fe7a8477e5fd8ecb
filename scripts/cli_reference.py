"""Write docs/cli.md from the commands themselves (a test compares the two).

python scripts/cli_reference.py            write the file
python scripts/cli_reference.py --check    say whether it is up to date, as an exit code
"""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path

import click

from lava_vpr.backends.rivals import BASELINES
from lava_vpr.cli import main
from lava_vpr.cli.show.matches import ALWAYS
from lava_vpr.config import DecoderConfig
from lava_vpr.matching.decoders import DECODERS

TARGET = Path(__file__).resolve().parent.parent / "docs" / "cli.md"
WIDTH = 100_000  # click breaks lines at the width of a terminal; here nothing is to be broken

HEAD = """# The command line

<!-- Written by scripts/cli_reference.py from the commands themselves: change them, then run it again. -->

```
{usage}
```

`--help` after a command shows what stands here. Work that takes long shows its progress on a terminal and is quiet in a
pipe. An output file that exists is replaced in one step when the new one is complete, and hands on its permissions.
Refused before any work is an output that is read-only, that is an input or another output of the command (by whatever
name: a link, a hard link), that would stand in the bundle that is read, or that would be a new image in a folder of
images that is read; `extend` and `remove` may replace the model that they change. Other new files may stand beside
images.

| exit code | meaning |
|---|---|
| 0 | done |
| 1 | the data or the result is at fault: one line on stderr names the file, the cause and the remedy |
| 2 | wrong usage |
"""

TAIL = """
## The figures of `eval --json`

Fractions in 0..1; what cannot be computed is `null`. Equal inputs write equal bytes: there are no times, dates or
paths.

```
{{"places": n, "queries": n,
 "network": {{"neurons": n, "weight_bits": n or null, "steps": n}},
 "default_decoder": NAME,
 "decoders": {{{decoders}}},
 "baselines": {{{baselines}}},
 "adapted": {{NAME: M}},
 "position_error": {{"median_m": x, "p90_m": x, "within": x, "radius_m": x, "matched": n}} or null,
 "followed": {{"filtered": M, "forward_backward": M}},
 "probability": {{"single": P, "filtered": P}},
 "curves": {{"decoders": {{NAME: C}}, "baselines": {{NAME: C}}, "adapted": {{NAME: C}}, "followed": {{NAME: C}}}}}}

M = {{"recall_at_1": x, "recall_at_n": {{"5": x, "10": x}}, "recall_at_100_precision": x,
     "precision_at_100_recall": x, "auc": x}}
P = {{"expected_calibration_error": x, "off_map": x,
     "reliability": [{{"answers": n, "probability": x, "right": x}}, ...],
     "thresholds": [{{"target": x, "probability": x, "accepted": x, "precision": x, "kept": x,
                     "false_accepts": x}}, ...]}}
C = {{"recall": [x, ...], "precision": [x, ...], "threshold": [x or null, ...]}}
```

The first four decoders are those of the paper. `baselines` holds those that were computed: `sad` compares
patch-normalised images of 28 x 28 pixels, `hog` HOG descriptors of 64 x 64 pixels, `cosine` the network's own input
rates, `descriptors` those given with `--descriptors`; `template` is the network without learning, the references'
rates as its weights. A model that was learned before there was `hog` keeps no descriptors of its references, and
preset `paper` has no templates: such a baseline is left out, and an error if it is asked for by name. `adapted` is
empty without `--adapt`. `position_error` is null where positions of places or queries are not known: metres from query
to match that half and 90 % of the `matched` queries do not exceed, and the share of all queries within `radius_m`.
`followed` is empty with `--motion none` and with sequences, and what is not known of probabilities is left out of
`probability`. A row of `thresholds` is a target precision: the least `probability` that it accepts, the share of all
queries that it `accepted`, the `precision` of these, the share of the queries on the map that it `kept`, accepted and
right, and that of the queries off the map that it accepted. A curve of `curves` is that of the matcher of its name, one
point for each distinct confidence, surest first: `threshold` is the least confidence that is accepted, null where it
is infinite (at the first point, where nothing is accepted, and at the last, if some queries match no place).

## The figures of `study --json`

Fractions in 0..1; what cannot be computed is `null`. Equal inputs write equal bytes, whatever `--jobs` says.

```
{{"study": NAME, "varied": TEXT, "places": n, "queries": n, "seeds": [n, ...], "board": NAME, "settings": {{...}},
 "points": [{{"point": TEXT, "value": x or null,
             "network": {{"recall_at_1": S, "recall_at_100_precision": S, "auc": S}},
             "baselines": {{NAME: {{"recall_at_1": x, "recall_at_100_precision": x, "auc": x}}}},
             "modelled": {{"microjoules": x, "milliseconds": x}} or null,
             "facts": {{NAME: S}}}}, ...]}}

S = {{"mean": x, "deviation": x or null, "by_seed": {{"0": x, ...}}}}
```

`value` is null where points are no numbers. `deviation` is the sample standard deviation over seeds, null of one seed.
`modelled` is of the first seed, null where costs do not change or the board cannot run the network. `facts` are what a
study counts besides: `neurons`, `covered` (share of the places), `theta_hyper`, `removed` (share of the neurons).

## The matches of `query`

Without `-o`, one image gets a sentence, and several get lines on standard output, as they do with `-o -`; each stands
there as soon as its image is done. The lines are CSV with the columns

```
{columns}
```

`query` is the index of the image in IMAGES, `place` that of the recognised place in the reference traverse, both
counted from 0 in the whole sequence. A query without match has place -1 and neither name nor confidence. `accepted` is
`true` or `false`: there is a match, of at least the probability that `--target-precision` asks for, or of at least
`--min-confidence`.

Where there is something to say, further columns follow, in this order; a query without match has none of what is said
of its match:

| columns | |
|---|---|
| `x,y` or `lat,lon` | Where the matched place was learned, if the model knows: metres or degrees. |
| `time` | When the query was taken, if name, frame or `--stamps` tells: seconds since 1970 or the video's start. |
| `error_m` | Metres from the query's position to the matched place's, if both are known. |
| `score`, `place_2,place_name_2,score_2`, ... | With `--top K`: the match's score; the next places, up to the K-th. |
| `probability_2`, ... | With `--motion`, too: the probability of each of these places, without its neighbours. |

With `--format jsonl` every line is an object of JSON with these columns as keys, in this order: numbers as numbers,
`accepted` as true or false, what is empty as null. Instead of the columns of `--top K` it has a list `candidates`, best
first, the match among them: `place`, `place_name`, `score`, `probability` (null where it is not known).
"""


def cell(text: str) -> str:
    """Text for one cell of a table: on one line, its bars no separators, a range in brackets no link."""
    return re.sub(r"\[(?=[^\[\]]*(?:x[<>]|[<>]=?x))", r"\\[", " ".join(text.split()).replace("|", r"\|"))


def paragraphs(text: str) -> str:
    """A docstring as Markdown paragraphs."""
    return "\n\n".join(" ".join(part.split()) for part in inspect.cleandoc(text).split("\n\n"))


def section(name: str, command: click.Command, parent: click.Context) -> str:
    """The reference of one command."""
    # Commands are shown as in a window so wide that nothing is broken.
    ctx = click.Context(command, info_name=name, parent=parent, terminal_width=WIDTH, max_content_width=WIDTH)
    usage = " ".join(command.get_usage(ctx).removeprefix("Usage:").split())
    rows = []
    for param in command.params:  # without --help, which all have
        record = param.get_help_record(ctx)
        if record is not None and isinstance(param, click.Option):
            rows.append(f"| `{cell(record[0])}` | {cell(record[1])} |")
    table = "\n\n" + "\n".join(["| option | |", "|---|---|", *rows]) if rows else ""
    return f"\n## {name}\n\n```\n{usage}\n```\n\n{paragraphs(command.help or '')}{table}\n"


def reference() -> str:
    """The whole text of docs/cli.md."""
    ctx = click.Context(main, info_name="lava-vpr", terminal_width=WIDTH, max_content_width=WIDTH)
    names = main.list_commands(ctx)
    commands = {name: main.get_command(ctx, name) for name in names}
    width = max(map(len, names))
    lines = [
        f"lava-vpr {name:<{width}}  {command.get_short_help_str(WIDTH)}"
        for name, command in commands.items()
        if command
    ]
    text = HEAD.format(usage="\n".join(lines))
    text += "".join(section(name, command, ctx) for name, command in commands.items() if command)
    decoders = sorted(DECODERS, key=lambda name: name == DecoderConfig().default)  # the paper's first, as in the file
    return text + TAIL.format(
        decoders=", ".join(f'"{name}": M' for name in decoders),
        baselines=", ".join(f'"{name}": M' for name in (*BASELINES, "descriptors")),
        columns=",".join(column.name for column in ALWAYS),
    )


def run(check: bool) -> int:
    """Write or compare; the exit code."""
    text = reference()
    if not check:
        TARGET.write_text(text, encoding="utf-8")
        return 0
    if TARGET.is_file() and TARGET.read_text(encoding="utf-8") == text:
        return 0
    print(f"{TARGET} is out of date; run python scripts/cli_reference.py", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(run("--check" in sys.argv[1:]))
