"""Whether environments give the same bytes: python scripts/same_answers.py FOLDER VENV VENV...

In each, the synthetic route is drawn, learned, asked and deployed by cases of the golden files, and real images where
LAVA_VPR_DATA names them. Every file must be equal to that of the first environment: images, models, matches,
figures, bundles.

Equal bytes are promised for equal versions of OpenCV, so another version in any environment is refused first.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path

ABOUT = """
import importlib.metadata as m, json, platform
def version(name):
    try:
        return m.version(name)
    except m.PackageNotFoundError:
        return "none"
names = {"numpy": "numpy", "lava-nc": "lava-nc", "OpenCV": "opencv-python-headless"}
print(json.dumps({"Python": platform.python_version()} | {k: version(v) for k, v in names.items()}))
"""


GOLDEN = Path(__file__).with_name("golden.py")
CASES = (
    *("learning/stretch-3", "asking/query", "asking/query-adapt", "asking/eval-places", "made/kb"),
    *("asking/nordland-query", "asking/nordland-adapt"),
)
"""Cases of the golden files whose files are compared, and those that they start from; the last are on real images."""


def output_of(*command: object) -> str:
    """What a command prints; ends this program if it fails."""
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(words)}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file that a case below ``folder`` wrote, by its name."""
    files = sorted(path for path in folder.glob("*/*/files/**/*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def main(out: Path, *venvs: Path) -> None:
    """Compare all environments with the first."""
    about = [json.loads(output_of(venv / "bin" / "python", "-c", ABOUT)) for venv in venvs]
    if len({one["OpenCV"] for one in about}) > 1:
        sys.exit(f"versions of OpenCV differ, so pixels may: {', '.join(one['OpenCV'] for one in about)}")
    found: list[dict[str, str]] = []
    for number, (venv, one) in enumerate(zip(venvs, about, strict=True)):
        folder = out / str(number)
        only = (word for case in CASES for word in ("--only", case))
        output_of(venv.resolve() / "bin" / "python", GOLDEN, "capture", folder, *only)
        for path in folder.glob("*/*/case.json"):
            if json.loads(path.read_text(encoding="utf-8"))["code"] != 0:
                sys.exit(f"{path.parent}: {path.with_name('stderr').read_text(encoding='utf-8')}")
        found.append(digests(folder))
        shown = "  ".join(f"{name} {digest[:12]}" for name, digest in found[-1].items() if name.endswith(".csv"))
        print("  ".join(f"{name} {version}" for name, version in one.items()), "", shown, sep="  ")
    for one, files in zip(about[1:], found[1:], strict=True):
        other = sorted(name for name in files.keys() | found[0].keys() if files.get(name) != found[0].get(name))
        if other:
            sys.exit(f"Python {one['Python']} differs from Python {about[0]['Python']} in {', '.join(other)}")
    print(f"same answers: {len(found[0])} files are equal in {len(venvs)} environments")


if __name__ == "__main__":
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    main(*(Path(word).absolute() for word in sys.argv[1:]))
