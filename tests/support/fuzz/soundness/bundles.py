"""Bundles: the manifest, the files that it lists, the references, and what a board gets.

Used by storage and support.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from support.fuzz.soundness import cores, loihi2, models, settings
from support.fuzz.soundness.parsing import array_of, container_of, json_of
from support.fuzz.soundness.rules import Findings, whole

REFERENCES = "host/references.lvpr"


def check_bundle(path: Path, view: Mapping[str, Any]) -> Findings:
    """The rules that a bundle breaks.

    Args:
        path: The folder.
        view: What the reader made of it, as for `models.check_model`, with the rebuilt ``weights`` and ``bias``.
    """
    findings = Findings()
    manifest = _manifest(path, findings)
    files = _files(path, manifest.get("files"), findings)
    if findings:
        return findings
    said = manifest.get("network")
    if not models.numbers(said, findings) or not isinstance(said, dict):
        return findings
    if not findings.need(all(whole(said.get(n), 1, (1 << 31) - 1) for n in ("inputs", "neurons")), "B3", "no sizes"):
        return findings
    silent = models.silence(said["neurons"], said["bias_input"])
    findings.need(whole(said.get("silent_steps"), silent, silent), "B3", "other silent steps")
    weights = view["weights"]
    models.sums(weights, said, findings)
    own = {name: said.get(name) for name in models.NUMBERS}
    findings.need(view["numbers"] == own, "B3", f"numbers {own} read as {view['numbers']}")
    sizes = (said.get("inputs"), said.get("neurons"))
    findings.need(weights.shape == sizes and all(type(n) is int for n in sizes), "B3", f"sizes {sizes}")
    config = dict(view["config"])
    header = _references(files, config, said, view, findings)
    if findings:
        return findings
    _host_files(files, header, said, findings)
    if manifest["target"] == "kapoho-bay":
        cores.check_cores(files, said, view, findings)
    else:
        loihi2.check_parameters(files, said, weights, findings)
        if "learning/learning.json" in files:
            loihi2.check_learning(files, config, header, findings)
    return findings


def _manifest(path: Path, findings: Findings) -> dict[str, Any]:
    """The manifest, empty if it cannot be read."""
    file = path / "manifest.json"
    if not findings.need(stat.S_ISREG(os.lstat(file).st_mode) or file.is_file(), "B1", "no manifest"):
        return {}
    value = json_of(file.read_bytes(), findings, "B1", "manifest")
    if not findings.need(isinstance(value, dict), "B1", "the manifest is no object"):
        return {}
    manifest: dict[str, Any] = value
    rest = {key: below for key, below in manifest.items() if key != "sha256"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    findings.need(manifest.get("sha256") == hashlib.sha256(text.encode()).hexdigest(), "B1", "another checksum")
    findings.need(manifest.get("format") == "lava-vpr bundle", "B1", "another format")
    findings.need(whole(manifest.get("version"), 1, 1), "B1", "another version")
    findings.need(manifest.get("target") in ("kapoho-bay", "loihi2"), "B1", "another board")
    return manifest


def _files(path: Path, listed: Any, findings: Findings) -> dict[str, bytes]:
    """The files that the manifest lists, by name."""
    files: dict[str, bytes] = {}
    if not findings.need(isinstance(listed, dict), "B2", "no list of files"):
        return files
    root = os.path.realpath(path)
    for name, facts in listed.items():
        parts = name.split("/")
        plain = name and "\0" not in name and not set(parts) & {"", ".", ".."} and "\\" not in name
        if not findings.need(plain and name.isprintable(), "B2", f"file {name!r:.40}"):
            continue
        file = path / name
        inside = os.path.realpath(file).startswith(root + os.sep)
        if not findings.need(inside and file.is_file(), "B2", f"{name!r:.40} is no file of the folder"):
            continue
        data = file.read_bytes()
        known = isinstance(facts, dict) and whole(facts.get("bytes"), 0, 1 << 40)
        right = known and (facts["bytes"], facts.get("sha256")) == (len(data), hashlib.sha256(data).hexdigest())
        findings.need(right, "B2", f"{name!r:.40}: not as the manifest says")
        files[name] = data
    return files


def _references(
    files: Mapping[str, bytes],
    config: dict[str, Any],
    said: dict[str, Any],
    view: Mapping[str, Any],
    findings: Findings,
) -> dict[str, Any]:
    """B3 of the references; their header, with the arrays under ``arrays``."""
    if not findings.need(REFERENCES in files, "B3", "no references"):
        return {}
    header, arrays = container_of(files[REFERENCES], "references", findings)
    if findings or not settings.check(config, findings):
        return {}
    settings.as_said(header.get("config"), config, findings)
    models.as_set(said, said["neurons"], config, findings)
    inputs = settings.inputs_of(config)
    findings.need(said["inputs"] == inputs, "B3", f"{said['inputs']} inputs, but the settings make {inputs}")
    told = {**header, "fixed": said}
    models.references(told, arrays, config, (said["inputs"], said["neurons"]), findings)
    learned = arrays.get("learned")
    findings.need(learned is not None and learned.shape == (0, 0), "M11", "learned weights in references")
    models.as_returned(header, arrays, view, findings)
    return {**header, "arrays": arrays}


def _host_files(files: Mapping[str, bytes], header: dict[str, Any], said: dict[str, Any], findings: Findings) -> None:
    """B4."""
    found: dict[str, NDArray[Any]] = {}
    images = len(header["arrays"]["labels"])
    kinds = {
        "rates": ("u2", (images, said["inputs"])),
        "keys": ("u8", (images,)),
        "labels": ("i8", (images,)),
        "responses": ("i4", header["arrays"]["responses"].shape),
    }
    for name, (kind, shape) in kinds.items():
        file = f"host/{name}.npy"
        if not findings.need(file in files, "B4", f"no {file}"):
            continue
        array = array_of(files[file], findings, file)
        if array is None:
            continue
        fits = array.dtype == np.dtype(kind) and array.shape == shape
        if findings.need(fits, "B4", f"{file} is {array.dtype} {array.shape}"):
            found[name] = array
    for name in ("labels", "responses"):
        if name in found:
            same = np.array_equal(found[name], header["arrays"][name])
            findings.need(same, "B4", f"host/{name}.npy is not that of the references")
