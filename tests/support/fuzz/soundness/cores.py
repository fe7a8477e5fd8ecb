"""The cores of a Loihi 1 bundle: registers, memory word by word, axons, and the host's tables.

Used by support.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from support.fuzz.soundness.parsing import array_of, json_of
from support.fuzz.soundness.rules import Findings, whole

WEIGHT_BITS, INDEX_BITS = (0, 1, 2, 3, 4, 5, 6, 8), (0, 6, 7, 8, 9, 10, 11, 12)
CHIPS, CORES, COMPARTMENTS, AXONS, WORDS = 2, 128, 1024, 4096, 16_384
DIRECT = 1024
TABLES = {"injection": 4, "inputs": 3, "exc": 3, "counters": 3, "inh": 3}
ARRAYS = {"compartments": ("i4", 4), "axons_in": ("i4", 3), "axons_out": ("i4", 4)}
PROFILE = {"decayU": 4095, "decayV": 4095, "refractDelay": 63, "enableNoise": 1, "bapAction": 1}
Core = dict[str, Any]


def check_cores(
    files: Mapping[str, bytes], said: Mapping[str, Any], view: Mapping[str, Any], findings: Findings
) -> None:
    """B5 to B8 of the cores in a bundle, whose reader returned the weights and biases of ``view``."""
    cores = _cores(files, findings)
    tables = {name: _array(files, f"host/{name}.npy", "i4", wide, findings) for name, wide in TABLES.items()}
    if findings:
        return
    for (chip, core), content in cores.items():
        _registers(content, f"chip {chip} core {core}", findings)
    if findings:
        return
    _places(cores, tables, said, findings)
    for place, content in cores.items():
        content["rows"] = _rows(content, str(place), findings)
    if findings:
        return
    weights, bias = view["weights"], view["bias"]
    decoded, owners = np.zeros(weights.shape, np.int64), _owners(tables["exc"])
    for number, place, axon in _ways(cores, tables):
        for compartment, current in cores[place]["rows"][axon]:
            if (*place, compartment) in owners:
                decoded[number, owners[(*place, compartment)]] += current >> 6
    findings.need(np.array_equal(decoded, weights), "B8", "memory holds other weights than the reader returns")
    settings = [cores[chip, core]["compartments"][k, 2:].tolist() for chip, core, k in tables["exc"].tolist()]
    same = [mantissa << exponent for mantissa, exponent in settings] == bias.tolist()
    findings.need(same, "B8", "compartments hold other biases than the reader returns")
    elsewhere = [
        core["compartments"][k, 2:].any()
        for place, core in cores.items()
        for k in range(len(core["compartments"]))
        if (*place, k) not in owners
    ]
    findings.need(not any(elsewhere), "B8", "a bias of another compartment than a neuron's")


def _cores(files: Mapping[str, bytes], findings: Findings) -> dict[tuple[int, int], Core]:
    """Every core by chip and core."""
    cores: dict[tuple[int, int], Core] = {}
    for folder in sorted({name.rsplit("/", 1)[0] for name in files if name.startswith("cores/")}):
        named = re.fullmatch(r"cores/chip(\d)-core(\d{3})", folder)
        inside = named is not None and int(named[1]) < CHIPS and int(named[2]) < CORES
        if not findings.need(inside, "B7", f"core {folder!r:.40}") or named is None:
            continue
        core: Core = {}
        registers = files.get(f"{folder}/registers.json")
        if findings.need(registers is not None, "B5", f"{folder}: no registers") and registers is not None:
            core["registers"] = json_of(registers, findings, "B5", f"{folder}/registers.json")
        for name, (kind, wide) in ARRAYS.items():
            core[name] = _array(files, f"{folder}/{name}.npy", kind, wide, findings)
        core["synapses"] = _array(files, f"{folder}/synapses.npy", "u8", None, findings)
        cores[int(named[1]), int(named[2])] = core
    findings.need(cores, "B7", "no cores")
    return cores


def _array(files: Mapping[str, bytes], name: str, kind: str, wide: int | None, findings: Findings) -> Any:
    if not findings.need(name in files, "B5", f"no {name}"):
        return None
    array = array_of(files[name], findings, name)
    if array is None:
        return None
    shaped = array.ndim == 1 if wide is None else array.ndim == 2 and array.shape[1] == wide
    findings.need(shaped and array.dtype == np.dtype(kind), "B5", f"{name} is {array.dtype} {array.shape}")
    return array


def _registers(core: Core, where: str, findings: Findings) -> None:
    """B5 of one core."""
    registers, size = core["registers"], len(core["compartments"])
    names = {"cxProfileCfg", "vthProfileCfg", "synapseFmt", "dendriteSharedCfg", "numUpdates"}
    if not findings.need(isinstance(registers, dict) and set(registers) == names, "B5", f"{where}: registers"):
        return
    try:
        profiles, thresholds, formats = (registers[name] for name in ("cxProfileCfg", "vthProfileCfg", "synapseFmt"))
        lists = all(isinstance(part, list) for part in (profiles, thresholds, formats))
        fits = lists and len(profiles) <= 32 and len(thresholds) <= 8 and 1 <= len(formats) <= 16 and formats[0] is None
        good = fits and all(
            set(profile) == set(PROFILE) and all(whole(profile[k], 0, most) for k, most in PROFILE.items())
            for profile in profiles
        )
        good = good and all(set(t) == {"vth"} and whole(t["vth"], 0, (1 << 17) - 1) for t in thresholds)
        good = good and all(_format(form) for form in formats[1:])
        shared, updates = registers["dendriteSharedCfg"], registers["numUpdates"]
        good = good and whole(shared["posVmLimit"], 0, 7) and whole(shared["negVmLimit"], 0, 23)
        good = good and whole(updates["numUpdates"], -(-size // 4), -(-size // 4)) and whole(updates["numStdp"], 0, 0)
    except (TypeError, KeyError, AttributeError):
        good = False
    findings.need(good, "B5", f"{where}: a register beyond its bits")
    counts = ((size, COMPARTMENTS), (len(core["axons_in"]), AXONS), (len(core["axons_out"]), AXONS))
    within = all(number <= most for number, most in (*counts, (len(core["synapses"]), WORDS)))
    findings.need(within and size > 0, "B5", f"{where}: more than a core holds")
    if not good:
        return
    table, limits = core["compartments"], ((0, len(profiles)), (0, len(thresholds)), (-4095, 4096), (0, 8))
    inside = all(bool(((table[:, k] >= low) & (table[:, k] < high)).all()) for k, (low, high) in enumerate(limits))
    findings.need(inside, "B5", f"{where}: a compartment of no profile, threshold or bias")


def _format(form: Mapping[str, Any]) -> bool:
    """Whether registers describe a synapse format."""
    good = whole(form["wgtBits"], 1, 7) and whole(form["idxBits"], 0, 7) and whole(form["wgtExp"], -7, 7)
    dense = form["compression"] == 3 and form["idxBits"] == 0
    sparse = form["compression"] == 0 and form["idxBits"] > 0
    rest = ("wgtBits", "idxBits", "wgtExp", "compression", "numSynapses", "fanoutType")
    unused = all(type(value) is int and value == 0 for name, value in form.items() if name not in rest)
    return bool(
        good and (dense or sparse) and whole(form["numSynapses"], 63, 63) and whole(form["fanoutType"], 1, 1) and unused
    )


def _owners(table: NDArray[Any]) -> dict[tuple[int, int, int], int]:
    """The neuron on every place that ``table`` names."""
    return {tuple(row): number for number, row in enumerate(table.tolist())}


def _places(
    cores: Mapping[tuple[int, int], Core],
    tables: Mapping[str, NDArray[Any]],
    said: Mapping[str, Any],
    findings: Findings,
) -> None:
    """B7."""
    neurons, biased = said["neurons"], said["bias_input"]
    inhibitory = 1 if neurons <= AXONS else -(-neurons // AXONS) + 1
    relayed = neurons > DIRECT and not biased
    sizes = {
        "exc": neurons,
        "counters": neurons,
        "inh": inhibitory,
        "inputs": said["inputs"] if biased or relayed else 0,
    }
    taken: set[tuple[int, ...]] = set()
    for name, size in sizes.items():
        rows = [tuple(row) for row in tables[name].tolist()]
        findings.need(len(rows) == size, "B7", f"{len(rows)} rows of {name} instead of {size}")
        inside = all(row[:2] in cores and 0 <= row[2] < len(cores[row[:2]]["compartments"]) for row in rows)
        findings.need(inside, "B7", f"{name} beyond the cores")
        findings.need(len(set(rows)) == len(rows) and not taken & set(rows), "B7", f"{name} on a taken compartment")
        taken |= set(rows)
    everywhere = {(*place, k) for place, core in cores.items() for k in range(len(core["compartments"]))}
    findings.need(taken == everywhere, "B7", "compartments of nobody")
    for number, chip, core, axon in tables["injection"].tolist():
        inside = 0 <= number < said["inputs"] and (chip, core) in cores
        inside = inside and 0 <= axon < len(cores[chip, core]["axons_in"]) and not biased
        findings.need(inside, "B7", f"injection of input {number} leads nowhere")
    for place, content in cores.items():
        for source, chip, core, axon in content["axons_out"].tolist():
            inside = 0 <= source < len(content["compartments"])
            inside = inside and (chip, core) in cores and 0 <= axon < len(cores[chip, core]["axons_in"])
            findings.need(inside, "B7", f"{place}: an output axon leads nowhere")


def _ways(
    cores: Mapping[tuple[int, int], Core], tables: Mapping[str, NDArray[Any]]
) -> list[tuple[int, tuple[int, int], int]]:
    """Input, core and input axon of every way from the inputs to neurons; to relays is none."""
    owners, sent = _owners(tables["inputs"]), tables["injection"].tolist()
    ways = [] if owners else [(number, (chip, core), axon) for number, chip, core, axon in sent]
    for place, content in cores.items():
        for source, chip, core, axon in content["axons_out"].tolist():
            if (*place, source) in owners:
                ways.append((owners[(*place, source)], (chip, core), axon))
    return ways


def _rows(core: Core, where: str, findings: Findings) -> list[list[tuple[int, int]]]:
    """Compartment and current, in units of u, of every synapse of every input axon; B6."""
    words = core["synapses"].tolist()
    memory = sum(word << 64 * k for k, word in enumerate(words))
    formats, size = core["registers"]["synapseFmt"], len(core["compartments"])
    entries = sorted({tuple(row) for row in core["axons_in"].tolist()})
    end = 0
    for first, length, count in entries:
        findings.need(first == end and length > 0 and count > 0, "B6", f"{where}: rows that do not tile the memory")
        end = first + length
    findings.need(end == len(words), "B6", f"{where}: words of nobody")
    known: dict[tuple[int, ...], list[tuple[int, int]]] = {}
    for entry in entries:
        synapses, good = _row(memory, entry, formats, size)
        findings.need(good, "B6", f"{where}: a row that is none")
        known[entry] = synapses
    return [known[tuple(row)] for row in core["axons_in"].tolist()]


def _row(memory: int, entry: tuple[int, ...], formats: list[Any], size: int) -> tuple[list[tuple[int, int]], bool]:
    """The synapses of one row, and whether they are what they should be."""
    first, length, count = entry
    at, end = first * 64, (first + length) * 64

    def take(bits: int) -> int:
        nonlocal at
        value = memory >> at & ((1 << bits) - 1)
        at += bits
        return value

    found: list[tuple[int, int]] = []
    while len(found) < count and at + 10 <= end:
        number, block = take(4), take(6) + 1
        if number >= len(formats) or formats[number] is None:
            return found, False
        form = formats[number]
        index, bits = INDEX_BITS[form["idxBits"]], WEIGHT_BITS[form["wgtBits"]]
        shift = 9 - bits + 6 + form["wgtExp"]
        for _ in range(block):
            compartment = take(index) if index else len(found)
            stored = take(bits)
            if stored >> bits - 1:  # two's complement
                stored -= 1 << bits
            found.append((compartment, stored << shift if shift >= 0 else stored >> -shift))
        rest = -at % 64
        if take(rest):
            return found, False
    return found, at == end and len(found) == count and all(0 <= compartment < size for compartment, _ in found)
