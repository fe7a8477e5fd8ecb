"""What a bundle will do on its board, before it is carried there: every spike of its registers, beside the host's.

    lava-vpr deploy route.lvpr --target kapoho-bay -o route-kb
    python examples/board_from_bundle.py route-kb route.lvpr winter/

The simulator reads nothing but the bundle's registers and synapse memory. At the board, the bundle's own program asks
the chip the same (`python route-kb/program/run.py --ladder FILE`).
"""

from __future__ import annotations

import argparse
import sys

from lava_vpr import LavaVprError, load
from lava_vpr.backends.interface import HostBackend, query_presentations
from lava_vpr.backends.registry import BACKENDS
from lava_vpr.encoding import encode_traverse
from lava_vpr.traverse import open_traverse


def main() -> None:
    """Compare the bundle's spikes with the model's."""
    parser = argparse.ArgumentParser(description="Compare the spikes of a bundle's registers with the host engine's.")
    parser.add_argument("bundle", help="the folder that lava-vpr deploy wrote, for Kapoho Bay")
    parser.add_argument("model", help="the model that it was made of")
    parser.add_argument("images", help="a folder, list, video or ROS bag")
    parser.add_argument("--limit", type=int, default=20, help="most images to ask (default: 20)")
    said = parser.parse_args()
    try:
        bundle, model = load(said.bundle), load(said.model)
        drive = open_traverse(said.images)
        queries = encode_traverse(drive.take(range(min(said.limit, len(drive)))), model.config.encoder)
        host, _ = HostBackend().count_spikes(model, query_presentations(model, queries))
        chip, _ = BACKENDS["bundle"].make(1, None).count_spikes(bundle, query_presentations(bundle, queries))
    except LavaVprError as error:
        sys.exit(f"error: {error}")
    differ = int((host != chip).sum()) if host.shape == chip.shape else host.size
    print(f"{len(queries)} images, {host.sum():,} spikes of the host engine, {chip.sum():,} of the bundle's registers")
    print("the bundle counts the same" if differ == 0 else f"{differ} counts differ: it was made of another model")
    sys.exit(bool(differ))


if __name__ == "__main__":
    main()
