"""Executes notebooks from the top: python scripts/run_notebook.py [NOTEBOOK...]; fails with the first cell that fails.

Without a name: all of docs/notebooks. Needs requirements/docs.txt. A terminal is told which cell runs. Stored outputs
play no part; ``--save`` replaces them by those of this run.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import io
import os
import re
import signal
import socket
import sys
import tempfile
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")


def prepare(folder: str) -> None:
    """Keep the user's own Jupyter, IPython and matplotlib settings out, and the kernel of this environment in."""
    os.environ.update(
        IPYTHONDIR=folder,
        JUPYTER_PREFER_ENV_PATH="1",
        MPLBACKEND="module://matplotlib_inline.backend_inline",
        PYDEVD_DISABLE_FILE_VALIDATION="1",
    )


def told(cell: int, cells: int) -> None:
    """Tell a terminal which cell runs."""
    if sys.stderr.isatty():
        print(f"\r  cell {cell} of {cells}\x1b[K", end="", file=sys.stderr, flush=True)


def execute(notebook: nbformat.NotebookNode, timeout: int) -> str | None:
    """Run all cells in a kernel of their own, in an empty folder; what failed, or None.

    Whatever happens, no process of the kernel is left: what a failed cell leaves of Lava would wait for ever.
    """
    groups: list[int] = []
    with tempfile.TemporaryDirectory(prefix="notebook-") as folder:
        prepare(folder)
        client = NotebookClient(
            notebook,
            timeout=timeout,
            kernel_name="python3",
            record_timing=False,
            coalesce_streams=True,
            resources={"metadata": {"path": folder}},
            extra_arguments=["--log-level=ERROR"],
        )
        client.on_notebook_start = lambda notebook: groups.append(client.km.provisioner.pgid)
        client.on_cell_execute = lambda cell, cell_index: told(cell_index + 1, len(notebook.cells))
        try:
            client.execute()
        except CellExecutionError as error:
            return _COLOURS.sub("", str(error))
        except CellTimeoutError as error:
            return f"a cell took more than {timeout} s: {error}"
        except DeadKernelError as error:
            return f"the kernel died: {error}"
        except RuntimeError as error:
            return f"the kernel did not start: {error}"
        finally:
            for group in groups:
                end(group)
    return None


def end(group: int) -> None:
    """End a group of processes: gently, so that shared memory is given back, then by force."""
    if group == os.getpgid(0):
        return
    with contextlib.suppress(ProcessLookupError):
        os.killpg(group, signal.SIGTERM)
        for _ in range(100):
            time.sleep(0.05)
            os.killpg(group, 0)
        os.killpg(group, signal.SIGKILL)


def tidy(notebook: nbformat.NotebookNode, colours: int = 192) -> None:
    """Leave what another run or machine would write, too: no warnings, which name files; plots in a few colours.

    Few colours are a third of the bytes; they are taken from all over, so that small things keep theirs.
    """
    notebook.metadata["language_info"] = {"name": "python"}
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            if "image/png" in data:
                plot, small = Image.open(io.BytesIO(base64.b64decode(data["image/png"]))), io.BytesIO()
                few = plot.convert("RGB").quantize(colours, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
                few.save(small, "PNG", optimize=True)
                data["image/png"] = base64.b64encode(small.getvalue()).decode("ascii")


def warnings_of(notebook: nbformat.NotebookNode) -> str:
    """What the cells wrote to stderr."""
    outputs = (output for cell in notebook.cells for output in cell.get("outputs", ()))
    return "".join(output.text for output in outputs if output.get("name") == "stderr")


def run_notebook(path: Path, timeout: int, save: bool) -> str | None:
    """Execute the notebook ``path``, and write its outputs into it if they are to be saved; what failed, or None."""
    notebook = nbformat.read(path, as_version=4)
    cells = sum(cell.cell_type == "code" for cell in notebook.cells)
    started = time.perf_counter()
    failure = execute(notebook, timeout)
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)
    if failure is not None:
        return f"{path.name}: {failure}"
    print(warnings_of(notebook), end="", file=sys.stderr)
    if save:
        tidy(notebook)
        text = nbformat.writes(notebook)
        for name in (str(ROOT), sys.prefix, str(Path.home()), socket.gethostname()):
            if re.search(rf"(?<![\w/+=]){re.escape(name)}\b", text):  # not by chance, within a picture
                return f"{path.name}: not saved, as an output names {name}"
        part = path.with_suffix(".part")
        part.write_text(text + "\n", encoding="utf-8")
        part.replace(path)
    print(f"{path.name}: {cells} cells run in {time.perf_counter() - started:.0f} s", flush=True)
    return None


def main() -> int:
    parser = argparse.ArgumentParser(description="Execute notebooks; exit with 1 if a cell fails.")
    parser.add_argument("notebooks", type=Path, nargs="*", help="default: all of docs/notebooks")
    parser.add_argument("--save", action="store_true", help="write the outputs into the notebooks")
    parser.add_argument("--timeout", type=int, default=300, help="seconds that one cell may take (default: 300)")
    args = parser.parse_args()
    for path in args.notebooks or sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")):
        failure = run_notebook(path, args.timeout, args.save)
        if failure is not None:
            print(failure, file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
