"""Learn a route on a Dask cluster of this machine's processors, as on one of many machines.

    python examples/local_cluster.py summer/ -o route.lvpr [--workers 2] [train's options ...]

Starts `dask scheduler`, some `dask worker`, and `lava-vpr train --cluster`; ends them when the route is learned.
Options that are not its own are handed to `lava-vpr train`. Needs `pip install 'lava-vpr[cluster]'`.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

DASK = [sys.executable, "-m", "dask"]
TRAIN = [sys.executable, "-m", "lava_vpr", "train"]
HERE = ["--host", "127.0.0.1", "--no-dashboard"]  # who can reach a scheduler can run programs: let nobody else


def scheduler_address(file: Path, scheduler: subprocess.Popen[bytes]) -> str:
    """The address that the scheduler wrote to ``file``, once it is there."""
    while scheduler.poll() is None:
        words = file.read_text().split('"') if file.exists() else []
        if "address" in words:
            return words[words.index("address") + 2]
        time.sleep(0.05)
    sys.exit("error: dask scheduler does not start; see above")


def main() -> None:
    """Start a cluster, learn, end the cluster."""
    parser = argparse.ArgumentParser(description="Learn a route on a Dask cluster of this machine.")
    parser.add_argument("reference", nargs="+", help="the drives to learn: folders, lists, videos or ROS bags")
    parser.add_argument("-o", "--output", required=True, help="the model to write (.lvpr)")
    parser.add_argument("--workers", type=int, default=2, help="worker processes, of one thread each")
    said, options = parser.parse_known_args()
    with tempfile.TemporaryDirectory() as folder:
        log, started = Path(folder) / "log", list[subprocess.Popen[bytes]]()

        def start(*words: str) -> subprocess.Popen[bytes]:
            with log.open("ab") as output:
                started.append(subprocess.Popen([*DASK, *words, *HERE], stdout=output, stderr=output, cwd=folder))
            return started[-1]

        try:
            file = Path(folder) / "scheduler.json"
            address = scheduler_address(file, start("scheduler", "--port", "0", "--scheduler-file", str(file)))
            for _ in range(said.workers):
                start("worker", address, "--nthreads", "1", "--no-nanny")
            learned = subprocess.run([*TRAIN, *said.reference, "-o", said.output, "--cluster", address, *options])
        finally:
            for process in started:
                process.kill()  # it keeps nothing; one that still starts may not heed a polite word
            for process in started:
                process.wait()
    sys.exit(learned.returncode)


if __name__ == "__main__":
    main()
