"""Executes a notebook from the top and fails with the first cell that fails: python scripts/run_notebook.py [NOTEBOOK]

Needs requirements/notebook.txt. Stored outputs play no part; ``--save`` replaces them by those of this run.
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


def tidy(notebook: nbformat.NotebookNode, colours: int = 96) -> None:
    """Leave what another run or machine would write, too: no warnings, which name files; plots in a few colours.

    Few colours are a third of the bytes.
    """
    notebook.metadata["language_info"] = {"name": "python"}
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            if "image/png" in data:
                plot, small = Image.open(io.BytesIO(base64.b64decode(data["image/png"]))), io.BytesIO()
                plot.convert("RGB").quantize(colours, dither=Image.Dither.NONE).save(small, "PNG", optimize=True)
                data["image/png"] = base64.b64encode(small.getvalue()).decode("ascii")


def warnings_of(notebook: nbformat.NotebookNode) -> str:
    """What the cells wrote to stderr."""
    outputs = (output for cell in notebook.cells for output in cell.get("outputs", ()))
    return "".join(output.text for output in outputs if output.get("name") == "stderr")


def main() -> int:
    parser = argparse.ArgumentParser(description="Execute a notebook; exit with 1 if a cell fails.")
    parser.add_argument("notebook", type=Path, nargs="?", default=ROOT / "docs" / "tutorial.ipynb")
    parser.add_argument("--save", action="store_true", help="write the outputs into the notebook")
    parser.add_argument("--timeout", type=int, default=300, help="seconds that one cell may take (default: 300)")
    args = parser.parse_args()
    notebook = nbformat.read(args.notebook, as_version=4)
    cells = sum(cell.cell_type == "code" for cell in notebook.cells)
    started = time.perf_counter()
    failure = execute(notebook, args.timeout)
    if failure is not None:
        print(f"{args.notebook.name}: {failure}", file=sys.stderr)
        return 1
    print(warnings_of(notebook), end="", file=sys.stderr)
    if args.save:
        tidy(notebook)
        text = nbformat.writes(notebook)
        for name in (str(ROOT), sys.prefix, str(Path.home()), socket.gethostname()):
            if re.search(rf"(?<![\w/+=]){re.escape(name)}\b", text):  # not by chance, within a picture
                print(f"{args.notebook.name}: not saved, as an output names {name}", file=sys.stderr)
                return 1
        part = args.notebook.with_suffix(".part")
        part.write_text(text + "\n", encoding="utf-8")
        part.replace(args.notebook)
    print(f"{args.notebook.name}: {cells} cells run in {time.perf_counter() - started:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
