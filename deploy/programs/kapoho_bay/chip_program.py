"""Writes the program of one chip's embedded processor: `embedded.c`, with a header of this chip's tables."""

import json
import os
import re
from typing import Callable

import numpy as np

from board_network import COUNTER_UNIT, Network
from packets import WORDS
from refusals import Refused

NO_AXON = 0xFFFF


def channel_names(chip: int) -> tuple:
    """Of the channel to a chip and of the one back."""
    return f"lv_to_chip_{chip}", f"lv_from_chip_{chip}"


def write_program(network: Network, chip: int, core_id: Callable[[int], int], folder: str) -> tuple:
    """Write it into a folder of its own; the path of the C file, and that folder.

    Args:
        network: The network.
        chip: The chip.
        core_id: NxSDK's id of a core of this chip.
        folder: Where to make the folder.
    """
    name, own = f"embedded_chip{chip}", os.path.join(folder, f"chip{chip}")
    os.makedirs(own)
    text = network.bundle.files["program/embedded.c"].decode()
    with open(os.path.join(own, name + ".c"), "w", encoding="utf-8") as file:
        file.write(text.replace('#include "embedded.h"', f'#include "{name}.h"'))
    with open(os.path.join(own, name + ".h"), "w", encoding="utf-8") as file:
        file.write(header(network, chip, core_id))
    return os.path.join(own, name + ".c"), own


def header(network: Network, chip: int, core_id: Callable[[int], int]) -> str:
    """Numbers and tables of one chip, in C."""
    exc = network.exc[network.exc[:, 0] == chip, 1:]
    counters = network.counters[network.exc[:, 0] == chip, 1:]
    sources = network.sources[network.sources[:, 0] == chip, 1:]
    injection = network.injection[network.injection[:, 1] == chip]
    own = np.array([core.core for core in network.cores if core.chip == chip and network.direct] or exc[:, 0])
    exc_cores, source_cores, targets = (np.unique(x).tolist() for x in (own, sources[:, 0], injection[:, 2]))
    axons = np.full((0 if network.bias_input else network.inputs, max(1, len(targets))), NO_AXON)
    axons[injection[:, 0], np.searchsorted(targets, injection[:, 2])] = injection[:, 3]
    to_chip, from_chip = channel_names(chip)
    numbers = {
        "FINGERPRINT": network.fingerprint,
        "STEPS": network.steps,
        "SILENT": network.silent,
        "BIAS_INPUT": int(network.bias_input),
        "ADAPTED": int(network.adapted),
        "HOST_SPIKES": network.host_spikes,
        "INPUTS": network.inputs,
        "COUNTER_UNIT": COUNTER_UNIT,
        "EXC": len(exc),
        "EXC_CORES": len(exc_cores),
        "SOURCES": len(sources),
        "SOURCE_CORES": len(source_cores),
        "TARGET_CORES": len(targets),
        "COMPARTMENTS": 4 * max(-(-len(core.compartments) // 4) for core in network.cores),
        "MESSAGES": WORDS if "one-word" in network.ways else 1,
        "BALLAST": network.ballast // 2,
    }
    for way in ("fields", "whole-cores", "phases", "masks"):
        numbers[way.upper().replace("-", "_")] = int(way in network.ways)
    numbers["WHOLE_CORES"] |= int(network.direct)  # populations of all kinds stand on them
    place = "struct { uint16_t core, compartment; }"
    lines = [f"/* Written by run.py for chip {chip}. */", '#include <stdint.h>\n#include "nxsdk.h"']
    lines += [f"#define LV_{name} ({value})" for name, value in numbers.items()]
    lines += [f'#define LV_TO_CHIP "{to_chip}"', f'#define LV_FROM_CHIP "{from_chip}"']
    lines += ["int lava_vpr_guard(runState *s);", "void lava_vpr_manage(runState *s);", "#ifdef LV_EMBEDDED_TABLES"]
    for name, places in (("exc", exc), ("counter", counters), ("source", sources)):
        lines += [table(place, name + "_places", [(core_id(core), cx) for core, cx in places.tolist()])]
    for name, cores in (("exc", exc_cores), ("source", source_cores), ("target", targets)):
        lines += [table("uint16_t", name + "_cores", [core_id(core) for core in cores])]
    lines += _targets(axons, "masks" in network.ways)
    if network.ballast:
        words = [0] * (network.ballast // 2 - 1) + [network.fingerprint & 0x7FFF]
        lines += [table("uint16_t", "ballast", words).replace("static const", "static const volatile")]
    return "\n".join([*lines, "#endif", ""])


def _targets(axons: np.ndarray, masks: bool) -> list:
    """The axon on each core that an input's spikes go to, (inputs, cores): as it is, or a bit an input and the axon
    that each 32 inputs begin with.

    Raises:
        Refused: axons do not follow each other as inputs do, so that bits do not say them.
    """
    inputs, cores = axons.shape
    if not masks:
        return [table("uint16_t", "target_axons", axons.tolist(), f"[{cores}]")]
    blocks = max(1, -(-inputs // 32))
    padded = np.full((32 * blocks, cores), NO_AXON)
    padded[:inputs] = axons
    there = (padded != NO_AXON).reshape(blocks, 32, cores)
    firsts = np.where(there.any(axis=1), padded.reshape(blocks, 32, cores).min(axis=1), 0)
    said = firsts[:, None] + there.cumsum(axis=1) - there
    if (said != padded.reshape(blocks, 32, cores))[there].any():
        raise Refused("input", "input axons of a core are not in the order of inputs; leave out --ways masks")
    words = (there * (1 << np.arange(32, dtype=np.int64))[:, None]).sum(axis=1)
    return [
        table("uint32_t", "target_masks", words.T.tolist(), f"[{blocks}]"),
        table("uint16_t", "target_firsts", firsts.T.tolist(), f"[{blocks}]"),
    ]


def table_bytes(network: Network, chip: int) -> int:
    """Bytes that the tables of a chip's program take, and the counts that it keeps."""
    text = header(network, chip, lambda core: core)
    numbers = [(kind, len(re.findall(r"\d+", values))) for kind, values in re.findall(r"const (\S+) .* = (.*);", text)]
    counts = 4 * int((network.exc[:, 0] == chip).sum())
    return counts + sum((4 if kind == "uint32_t" else 2) * count for kind, count in numbers)


def table(kind: str, name: str, rows: list, inner: str = "") -> str:
    """A constant array in C; one element of zeros if there is none."""
    text = json.dumps(rows or [[0]]).replace("[", "{").replace("]", "}")
    text = text.replace("{{0}}", "{0}") if not rows and not inner else text
    return f"static const {kind} lv_{name}[{max(1, len(rows))}]{inner} = {text};"
