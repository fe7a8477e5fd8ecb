"""The golden files: python scripts/golden.py compare; see tests/golden/command.py."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

if __name__ == "__main__":
    from golden.command import main

    sys.exit(main(sys.argv[1:]))
