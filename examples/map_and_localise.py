"""Learn a route in one season, and follow a drive along it in another, image by image.

    python examples/map_and_localise.py summer/ winter/ -o route.lvpr

Each line says what a robot would know at that moment: the place, how likely it is, and whether that is enough.
"""

from __future__ import annotations

import argparse
import sys

from lava_vpr import LavaVprError, Localizer, train
from lava_vpr.traverse import open_traverse


def main() -> None:
    """Learn, follow, and keep the map."""
    parser = argparse.ArgumentParser(description="Learn a route, and follow a drive along it.")
    parser.add_argument("reference", help="the drive to learn: a folder, list, video or ROS bag")
    parser.add_argument("query", help="the drive to follow")
    parser.add_argument("-o", "--output", help="keep the map in this file (.lvpr)")
    said = parser.parse_args()
    try:
        robot = Localizer(train(said.reference), motion="any", target_precision=0.95)
        drive, kept = open_traverse(said.query), 0
        for name, image in zip(drive.names, drive.images(), strict=True):
            match = robot.update(image)
            kept += match.accepted
            where = match.name if match.accepted else "not sure" if match.off_map < 0.5 else "off the map"
            print(f"{name}: {where} (probability {match.probability:.2f}, {match.spikes.sum()} spikes)")
        if said.output:
            robot.save(said.output)
    except LavaVprError as error:
        sys.exit(f"error: {error}")
    print(f"{kept} of {len(drive)} images accepted")


if __name__ == "__main__":
    main()
