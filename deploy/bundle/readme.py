"""The README in a bundle, for the person at the board."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from typing import Any

from lava_vpr.deploy.boards.plan import Plan
from lava_vpr.deploy.bundle.front_end import held_sentence
from lava_vpr.deploy.hardware.belief import HardwareBelief
from lava_vpr.deploy.mapping.front_end import PlacedFrontEnd
from lava_vpr.deploy.show.tables import modelled_time
from lava_vpr.inputs.front_end import FrontEnd
from lava_vpr.loihi import reset_interval
from lava_vpr.model import Model

_TEXT = """\
# A place network for {title}

It recognises {places} places (`{first}` to `{last}`) with {neurons} excitatory neurons, {inhibitory} inhibitory
and {inputs} inputs; weights of {bits} bits{signs}; {steps} steps of input a query, then {silent} silent ones.
Input is {way}.
{time}
{before}
{programs}
## What is what

- `manifest.json`: network, limits of the board, how states are cleared between queries, checksums of all
  files. The programs refuse to run a bundle that was altered.
{parts}- `host/rates.npy`, `host/keys.npy`: the reference images as spike probabilities (units of 2^-16 a step) and
  the keys of their random numbers; `host/responses.npy`: the spike counts (neurons, places) they must give.
- `host/references.lvpr`: names, settings and small images, for lava-vpr's decoders and reports.

A place's score is the sum over neurons of responses[i, place] / responses[i].sum() * counts[i], which the
configured decoder scales; the highest score is the place.

## What no public source shows

This bundle rests on these beliefs about the hardware; lava-vpr's docs/hardware.md says why they are held.

{unproven}
"""

KAPOHO_BAY = """\
Needs: the board, Intel's NxSDK 0.9 to 1.0 (closed; from Intel's neuromorphic research community) and a Python
that has it, with numpy. NxSDK compiles `program/embedded.c` for the chips' embedded processors. Nothing else,
not lava-vpr.

    export KAPOHOBAY=1                         NxSDK looks for this board then
    python program/run.py --check              everything but the board: the files (without numpy or NxSDK), NxSDK
    python program/run.py --simulate --self-test 5  the registers in numpy, no board and no NxSDK needed
    python program/run.py --ladder FILE     self-tests from one neuron on; FILE is what to send back
    .. --ways W,W                              other ways to ask the board, which --ladder finds and names
    python program/run.py --self-test          the reference images; counts must equal host/responses.npy
    python program/run.py --queries Q --out R  Q/rates.npy and Q/keys.npy in, R/counts.npy out; Q/biases.npy and
                                               Q/exponents.npy, if there are: biases of each query
    .. --power P                               P, JSON: power in mW and time of a step, idle subtracted

With lava-vpr on the same machine, images go in and places come out:

    NXSDK_PYTHON=/path/to/python lava-vpr eval THIS_FOLDER QUERY_IMAGES --backend kapoho-bay
"""

LOIHI_2 = """\
Needs: Lava 0.10 under Python 3.10, Intel's lava-loihi (closed; from Intel's neuromorphic research community)
and a configured Loihi 2 host (SLURM=1 or NXSDKHOST). Nothing else, not lava-vpr. Lava makes sockets in the
temporary folder and their paths must be short: if TMPDIR has over 59 characters, `export TMPDIR=/tmp`.

    python program/run.py --check                 everything but the board
    python program/run.py --simulate --self-test  Lava's bit-accurate simulation, no board
    python program/run.py --ladder FILE        self-tests from one neuron on; FILE is what to send back
    .. --ways W,W                                 other ways to ask the board, which --ladder finds and names
    python program/run.py --self-test             the reference images; counts must equal host/responses.npy
    python program/run.py --queries Q --out R     Q/rates.npy and Q/keys.npy in, R/counts.npy out; Q/biases.npy
                                                  and Q/exponents.npy, if there are: biases of each query
    .. --power P                                  P, JSON: power in mW and time of a step, idle subtracted

With lava-vpr on the same machine, images go in and places come out:

    lava-vpr eval THIS_FOLDER QUERY_IMAGES --backend loihi2
"""

CORES = """\
- `cores/chipC-coreNNN/`: registers, compartments (profile, threshold, bias mantissa, bias exponent), synapse
  memory in 64-bit words, input axons (first word, words, synapses), output axons (source, chip, core, axon).
- `host/injection.npy` (input, chip, core, axon), `host/inputs.npy`, `host/exc.npy`, `host/counters.npy`,
  `host/inh.npy` (chip, core, compartment): where spikes go in, and where they are counted.
- `mapping.json`, `mapping.svg`: what each core holds.
"""

NETWORK = """\
- `network/`: the parameters of Lava's own Dense, Sparse and LIFReset; Intel's compiler places them.
- `mapping.json`, `mapping.svg`: an estimate by the limits that are public.
"""

_PIXELS = """\
# From pixels to places on {title}

It recognises {places} places (`{first}` to `{last}`). {guide}
## What is what

- `manifest.json`: network, limits of the board, how states are cleared between queries, checksums of all
  files. The programs refuse to run a bundle that was altered.
{parts}- `host/weights.npy`, `host/bias.npy`: the network of places, as these files hold it.
- `host/pixels.npy`, `host/counts.npy`: small pictures of places, and the spike counts that they must give.
- `host/responses.npy`, `host/references.lvpr`: spike counts of the references, names, settings and small images, for
  lava-vpr's decoders and reports.

A place's score is the sum over neurons of responses[i, place] / responses[i].sum() * counts[i], which the
configured decoder scales; the highest score is the place.

## What no public source shows

This bundle rests on these beliefs about the hardware; lava-vpr's docs/hardware.md says why they are held.

{unproven}
"""

PIXELS_KAPOHO_BAY = """\
Pixels are written once a query; {total:,} neurons on {cores}
cores, of which {neurons} stand for places, spike for {steps} steps; then the counts of these are read. The host
computes nothing between the two. What each population takes is in `mapping.json`.

Needs: the board, Intel's NxSDK 0.9 to 1.0 (closed; from Intel's neuromorphic research community) and a Python
that has it, with numpy. NxSDK compiles `program/embedded.c` for the chips' embedded processors. Nothing else,
not lava-vpr.

    export KAPOHOBAY=1                         NxSDK looks for this board then
    python program/run.py --check              everything but the board: the files (without numpy or NxSDK), NxSDK
    python program/run.py --simulate --self-test 2  the registers in numpy, no board and no NxSDK needed
    python program/run.py --ladder FILE     self-tests from one neuron on; FILE is what to send back
    python program/run.py --self-test          small pictures of places; counts must equal host/counts.npy
    python program/run.py --queries Q --out R  Q/pixels.npy uint8 (n, {height}, {width}) in, R/counts.npy out
    .. --power P                               P, JSON: power in mW and time of a step, idle subtracted

With lava-vpr on the same machine, images go in and places come out:

    NXSDK_PYTHON=/path/to/python lava-vpr eval THIS_FOLDER QUERY_IMAGES --backend kapoho-bay
"""

PIXELS_LOIHI_2 = """\
Pixels are written once a query; {total:,} neurons, of which {neurons}
stand for places, spike for {steps} steps of the {interval} after which all are reset; Lava counts the spikes of these.
The host computes nothing between the two. What each population takes, by the limits that are public, is in
`mapping.json`: at least {cores} cores.

Needs: Lava 0.10 under Python 3.10, Intel's lava-loihi (closed; from Intel's neuromorphic research community)
and a configured Loihi 2 host (SLURM=1 or NXSDKHOST). Nothing else, not lava-vpr. Lava makes sockets in the
temporary folder and their paths must be short: if TMPDIR has over 59 characters, `export TMPDIR=/tmp`.

    python program/run.py --check                 everything but the board
    python program/run.py --simulate --self-test 2  Lava's bit-accurate simulation, no board
    python program/run.py --ladder FILE           one small picture, then all; FILE is what to send back
    .. --ways W,W                                 other ways to ask the board, which --ladder finds and names
    python program/run.py --self-test             small pictures of places; counts must equal host/counts.npy
    python program/run.py --queries Q --out R     Q/pixels.npy uint8 (n, {height}, {width}) in, R/counts.npy out

Pixels are written between runs of the board, so that `--power`, which needs all queries in one run, is refused.
"""

PIXELS_CORES = """\
- `front_end/cores/chipC-coreNNN/`: registers, compartments (profile, threshold, bias mantissa, bias exponent), synapse
  memory in 64-bit words, input axons (first word, words, synapses), output axons (source, chip, core, axon).
- `front_end/host/`: chip, core and compartment of every neuron of each population; `exc` are the neurons of places,
  `counters` count their spikes.
"""

PIXELS_NETWORK = """\
- `network/parameters.json`: what Lava's own LIFReset and Sparse are made with; `exc` are the neurons of places, the
  mantissas of `pixels` their grey levels.
- `network/NN-SOURCE-TARGET/`: weights, sources and where each target's begin, of synapses of one sign and exponent;
  Intel's compiler places them.
"""

_LEARNING = "- `learning/`: the network that learns, for Lava's LearningDense: rule, start weights, schedule.\n"
_GAINED = """\
- `host/gains.lvpg`: what the queries of a drive are presented with, gains of inputs and biases of neurons. With
  `Q/activity.npy` alone, the activity of the same images in order, float32 (n, inputs), `--queries Q` does so.
"""
_FRONT_END = """\
- `front_end/cores/`, `front_end/host/`: the spiking front end, in the same formats: pixels' biases are written once an
  image.
"""
_INJECTED = "{} trains, injected spike by spike"
_BIAS = "integrated by input compartments from a bias written once a query"


def direct_readme(
    model: Model, spec: FrontEnd, plan: PlacedFrontEnd, guide: str, parts: str, unproven: Iterable[HardwareBelief]
) -> bytes:
    """What the folder is and how to run it, of a network that hears the cells of the front end ``spec``.

    Args:
        model: What the bundle holds.
        spec: The front end.
        plan: Where its neurons stand.
        guide: What it takes and how to run the board's program.
        parts: What the files of the network are.
        unproven: The rows of the table of hardware that it rests on and no public source shows.
    """
    told = guide.format(
        total=sum(spec.populations.values()),
        cores=plan.cores,
        neurons=model.neurons,
        steps=spec.steps,
        interval=reset_interval(spec.steps),
        height=spec.height,
        width=spec.width,
    )
    return _PIXELS.format(
        title=plan.board.title,
        places=model.places,
        first=model.place_names[0],
        last=model.place_names[-1],
        guide=told,
        parts=parts,
        unproven=_rows(unproven),
    ).encode()


def _rows(unproven: Iterable[HardwareBelief]) -> str:
    return "\n".join(f"- {row.name}: if it is wrong, {row.breaks}" for row in unproven)


def readme(
    model: Model,
    plan: Plan,
    guide: str,
    parts: str,
    unproven: Iterable[HardwareBelief],
    *,
    learning: bool = False,
    gained: bool = False,
    front_end: Mapping[str, Any] | None = None,
) -> bytes:
    """What the folder is and how to run it.

    Args:
        model: What the bundle holds.
        plan: Where its neurons stand.
        guide: How to run the board's program.
        parts: What the files of the network are.
        unproven: The rows of the table of hardware that it rests on and no public source shows.
        learning: Whether the bundle also holds the network that learns.
        gained: Whether it also holds the gains and biases of a drive's queries.
        front_end: What its manifest says of a spiking front end; None: the model has none.
    """
    network = plan.network
    text = _TEXT.format(
        title=plan.board.title,
        places=model.places,
        first=model.place_names[0],
        last=model.place_names[-1],
        neurons=network.neurons,
        inhibitory=network.inhibitory,
        inputs=network.inputs,
        bits=network.bits,
        signs=" and a sign" if network.signed else "",
        steps=network.steps,
        silent=network.silent_steps,
        time=textwrap.fill(modelled_time(plan), 110),
        way=_BIAS if network.bias_input else _INJECTED.format("regular" if network.regular else "Poisson"),
        before=f"\n{textwrap.fill(held_sentence(front_end), 110)}\n" if front_end else "",
        programs=guide,
        parts=parts + _LEARNING * learning + _GAINED * gained + _FRONT_END * ("cores" in (front_end or ())),
        unproven=_rows(unproven),
    )
    return text.encode()
