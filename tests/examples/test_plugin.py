"""The example package, installed beside lava-vpr: rule, neurons and decoder are used, doctor lists all."""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.common import children
from support.common.commands import CONFIG, PLACES, recall

from lava_vpr.storage import container
from lava_vpr.synthetic.world import write_traverses

SOURCE = Path(__file__).resolve().parents[2] / "examples" / "plugin"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which pip has installed the example."""
    folder = tmp_path_factory.mktemp("plugin")
    shutil.copytree(SOURCE, folder / "source", ignore=shutil.ignore_patterns("*.egg-info", "build", "__pycache__"))
    options = ("--quiet", "--disable-pip-version-check", "--no-deps", "--no-index", "--no-build-isolation")
    where = ("--target", folder / "site", folder / "source")
    children.run([sys.executable, "-m", "pip", "install", *options, *where], check=True, timeout=300)
    return folder / "site"


def lava_vpr(folder: Path, site: Path | None, *words: object) -> subprocess.CompletedProcess[str]:
    """A command, with the example on the path or without."""
    others = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return children.run(
        [sys.executable, "-m", "lava_vpr", *map(str, words)],
        cwd=folder,
        env=others if site is None else {**others, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


@pytest.mark.slow
def test_its_input_its_learning_rule_and_its_decoder_are_used(site: Path, tmp_path: Path) -> None:
    write_traverses(tmp_path, PLACES, 0)
    (tmp_path / "quick.toml").write_text(f"{CONFIG}[decoder]\ndefault = 'count-cosine'\n")
    words = ("train", "reference", "-o", "m.lvpr", "--config", "quick.toml", "--input", "centre-surround")
    words += ("--learning", "oja", "--epochs", "8")
    done = lava_vpr(tmp_path, site, *words)
    assert (done.returncode, done.stderr) == (0, "")
    done = lava_vpr(tmp_path, site, "query", "m.lvpr", "query", "--min-confidence", "0", "-o", "m.csv")
    assert (done.returncode, done.stderr) == (0, "")
    with (tmp_path / "m.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert sum(int(row["query"]) == int(row["place"]) for row in rows) >= PLACES - 2
    assert all(0 <= float(row["confidence"]) <= 1 for row in rows)  # a margin between cosines
    done = lava_vpr(tmp_path, site, "train", "reference", "-o", "t.lvpr", *words[4:8], "--learning", "template")
    assert (done.returncode, done.stderr) == (0, "")
    made = [container.load(tmp_path / name, "model") for name in ("m.lvpr", "t.lvpr")]
    assert [header["config"]["learning"]["rule"] for header, _ in made] == ["oja", "template"]
    oja, template = (arrays["learned"] for _, arrays in made)
    assert 0.01 < np.abs(oja - template).max() < 2.0
    done = lava_vpr(tmp_path, site, "doctor")
    assert done.returncode == 0
    listed = [line.split() for line in done.stdout.splitlines() if "lava-vpr-example" in line]
    assert [[word for word in line if word not in "│┃"][-4:] for line in listed] == [
        ["centre-surround", "lava-vpr-example", "0.1.0", "yes"],
        ["oja", "lava-vpr-example", "0.1.0", "yes"],
        ["adaptive", "lava-vpr-example", "0.1.0", "yes"],
        ["count-cosine", "lava-vpr-example", "0.1.0", "yes"],
    ]

    done = lava_vpr(tmp_path, None, "query", "m.lvpr", "query")
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith(
        "lava-vpr: error: m.lvpr: the model cannot be used (decoder.default is 'count-cosine', but must be one of "
        "contrast, standard, weighted, probability, weighted_probability, or install the package that has it among its "
        "entry points lava_vpr.decoders; "
    )
    assert "no plug-ins" in lava_vpr(tmp_path, None, "doctor").stdout


@pytest.mark.slow
def test_its_neurons_answer_on_the_host_alone(site: Path, tmp_path: Path) -> None:
    write_traverses(tmp_path, PLACES, 0)
    (tmp_path / "lif.toml").write_text(CONFIG)
    (tmp_path / "adaptive.toml").write_text(CONFIG.replace("[network]\n", "[network]\nmodel = 'adaptive'\n"))
    for name in ("lif", "adaptive"):
        done = lava_vpr(tmp_path, site, "train", "reference", "-o", f"{name}.lvpr", "--config", f"{name}.toml")
        assert (done.returncode, done.stderr) == (0, "")
    lif, adaptive = (container.load(tmp_path / f"{name}.lvpr", "model")[1] for name in ("lif", "adaptive"))
    assert np.array_equal(lif["network.weights"], adaptive["network.weights"])
    assert 0.2 < adaptive["responses"].sum() / lif["responses"].sum() < 0.9  # thresholds rise
    done = lava_vpr(tmp_path, site, "eval", "adaptive.lvpr", "query", "--json", "e.json")
    assert (done.returncode, done.stderr) == (0, "")
    assert recall(json.loads((tmp_path / "e.json").read_text())) >= 1 - 2 / PLACES
    done = lava_vpr(tmp_path, site, "verify", "adaptive.lvpr", "query", "--limit", "2", "--json", "v.json")
    assert done.returncode == 0
    verdicts = json.loads((tmp_path / "v.json").read_text())["backends"]
    assert [name for name, verdict in verdicts.items() if verdict["available"]] == ["host"]
    neurons = "adaptive (LIF with a threshold that spikes raise)"
    needs = (
        f"needs neurons of network.model lif, but these are {neurons}, which only --backend host runs; train with lif"
    )
    for what, words in {
        "Kapoho Bay": ("deploy", "adaptive.lvpr", "--target", "kapoho-bay", "-o", "b"),
        "Loihi 2": ("fit", "adaptive.lvpr", "--target", "loihi2"),
        "bench": ("bench", "adaptive.lvpr", "query"),
    }.items():
        done = lava_vpr(tmp_path, site, *words)
        assert (done.returncode, done.stdout) == (1, "")
        (line,) = done.stderr.splitlines()
        assert line.startswith(f"lava-vpr: error: adaptive.lvpr: {what} ")
        assert line.endswith(needs)
    done = lava_vpr(tmp_path, None, "query", "adaptive.lvpr", "query")
    assert done.returncode == 1
    assert done.stderr.startswith(
        "lava-vpr: error: adaptive.lvpr: the model cannot be used (network.model is 'adaptive', but must be lif, or "
        "install the package that has it among its entry points lava_vpr.neuron_models; "
    )
    assert done.stderr.count("\n") == 1
