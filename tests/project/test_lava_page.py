"""docs/lava.md names every Process, port and Var, and its first example runs."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
from support.common import children

ROOT = Path(__file__).resolve().parents[2]
LAVA_PAGE = ROOT / "docs" / "lava.md"

BASES = {
    "LifProcess": "neurons.py",
    "EncoderProcess": "encoders.py",
    "ListedEncoderProcess": "encoders.py",
    "NetworkProcess": "network.py",
}
"""The classes in `processes/base` that make arguments, ports and Vars for others: their files."""


def processes() -> dict[str, tuple[str, str]]:
    """Every Process of `processes/`: its folder and the text that makes its arguments, ports and Vars."""
    found = {}
    made = {name: (ROOT / "processes" / "base" / file).read_text() for name, file in BASES.items()}
    for path in (ROOT / "processes").rglob("process.py"):
        text = path.read_text()
        for node in ast.parse(text).body:
            bases = [ast.unparse(b) for b in node.bases] if isinstance(node, ast.ClassDef) else []
            if isinstance(node, ast.ClassDef) and any(name.endswith("Process") for name in bases):
                folder = str(path.parent.relative_to(ROOT / "processes"))
                found[node.name] = (
                    folder,
                    f"{ast.get_source_segment(text, node)}\n" + "".join(made.get(name, "") for name in bases),
                )
    return found


def rows() -> dict[str, tuple[str, list[str]]]:
    """The page's table of Processes: folder and the other cells of each row."""
    table = re.findall(r"^\| `(\w+)` `([\w/]+)` \|(.*)\|$", LAVA_PAGE.read_text(), re.MULTILINE)
    return {name: (folder, rest.split(" | ")) for name, folder, rest in table}


def test_the_page_lists_every_process_and_no_other() -> None:
    assert {name: folder for name, (folder, _) in processes().items()} == {
        name: folder for name, (folder, _) in rows().items()
    }


@pytest.mark.parametrize("name", sorted(processes()))
def test_the_page_gives_its_arguments_ports_and_vars(name: str) -> None:
    _, text = processes()[name]
    _, (arguments, ports, variables, _) = rows()[name]
    classes = {node.name: node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ClassDef)}
    makers = [
        {argument.arg for argument in node.args.kwonlyargs}
        for made_by in (name, *BASES)  # whose arguments a Process passes on
        if made_by in classes
        for node in classes[made_by].body
        if isinstance(node, ast.FunctionDef) and node.name == "__init__"
    ]
    taken = set().union(*makers)
    for argument in makers[0]:
        assert re.search(rf"\b{argument}\b", arguments), f"{argument} is missing"
    for argument in re.findall(r"(?:^|, )\s*(\w+)(?=[=,: (]|$)", arguments.strip()):
        assert argument in taken, f"{argument} is no argument"
    if ports.strip() == "as above":  # InhibitoryLIF, whose class is the same
        return
    # Ports and Vars are named where they are made: as attributes, or in a loop over their names.
    listed = set(re.findall(r"`(\w+)`", ports + variables))
    made = set(re.findall(r"self\.(\w+)(?=[\w., ]*(?:: \w+)? = .*(?:InPort|OutPort|Var)\()", text))
    for line in re.findall(r"^\s*((?:self\.\w+, )+self\.\w+) = .*Var\(", text, re.MULTILINE):
        made |= set(re.findall(r"self\.(\w+)", line))
    if "setattr(self" in text:
        made |= {"u", "v", "held", "du", "dv", "floor", "hold_steps", "theta_plus", "vth", "bias_mant", "bias_exp"}
    assert listed == made


def test_backends_that_the_page_names_exist() -> None:
    from lava_vpr.backends.registry import BACKENDS

    text = LAVA_PAGE.read_text()
    assert all(f"`{name}`" in text for name in BACKENDS)
    assert set(re.findall(r"`(lava-(?!nc|vpr|loihi|dl)\w+)`", text)) <= set(BACKENDS)


BEFORE = """
import numpy as np
from lava_vpr import encoding, model as file
from lava_vpr.config import Config, EncoderConfig
from lava_vpr.encoding import Keep
from lava_vpr.engine.inference.counting import count_spikes
from lava_vpr.synthetic import write_traverses
from lava_vpr.training import train
from lava_vpr.traverse import open_traverse
from pathlib import Path

write_traverses(Path("route"), places=4, seed=0)
config = Config(encoder=EncoderConfig(orientations=4))
references = encoding.encode_traverse(open_traverse("route/reference"), config.encoder, Keep.ALL)
file.save(train([references], config), Path("route.lvpr"))
"""
AFTER = """
assert counts.sum() > 20
assert np.array_equal(counts, count_spikes(spec, rates, keys)[0])
assert np.array_equal(network.weights.shape, spec.weights.T.shape)
"""


@pytest.mark.lava
def test_the_first_example_of_the_page_gives_the_hosts_counts(tmp_path: Path) -> None:
    example = re.findall(r"```python\n(.*?)```", LAVA_PAGE.read_text(), re.DOTALL)[0]
    (tmp_path / "example.py").write_text(BEFORE + example + AFTER)
    with (tmp_path / "log").open("w") as log:
        done = children.run(
            [sys.executable, "example.py"],
            cwd=tmp_path,
            timeout=240,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            check=False,
        )
    assert done.returncode == 0, (tmp_path / "log").read_text()
