"""``python -m lava_vpr``."""

from lava_vpr.cli import main

if __name__ == "__main__":
    main(prog_name="lava-vpr")
