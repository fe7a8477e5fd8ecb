"""Replay a ROS bag through a map, without ROS: where was each image taken?

    python examples/replay_bag.py route.lvpr drive.mcap --topic /camera/image --rate 1

A line for each image: seconds since the first, place, probability, whether it is accepted. `lava-vpr watch route.lvpr
drive.mcap` says more of each, as JSON; this is the shortest way to the same answers in Python.
"""

from __future__ import annotations

import argparse
import sys
import time

from lava_vpr import LavaVprError, Localizer
from lava_vpr.traverse import open_traverse


def arguments() -> argparse.ArgumentParser:
    """The program's options."""
    parser = argparse.ArgumentParser(description="Replay a ROS bag through a map.")
    parser.add_argument("model", help="a model file or bundle")
    parser.add_argument("bag", help="a .bag, .db3 or .mcap file, or the folder of a ROS 2 bag")
    parser.add_argument("--topic", default="", help="topic of the images (default: the only one that has some)")
    parser.add_argument("--every", type=float, default=1.0, help="seconds between two images")
    parser.add_argument("--motion", choices=("any", "forward", "none"), default="any", help="how the robot may move")
    parser.add_argument(
        "--rate", type=float, default=0.0, help="times as fast as it was recorded (0: as fast as it can)"
    )
    return parser


def replay(said: argparse.Namespace) -> None:
    """Ask the map about one image after the other, and print what it says."""
    robot = Localizer(said.model, motion=said.motion)
    drive = open_traverse(f"{said.bag}:{said.topic}" if said.topic else said.bag, every=said.every)
    stamps = [0.0] * len(drive) if drive.stamps is None else drive.stamps.tolist()
    began = time.monotonic()
    for stamp, image in zip(stamps, drive.images(), strict=True):
        since = stamp - stamps[0]
        if said.rate > 0:
            time.sleep(max(0.0, began + since / said.rate - time.monotonic()))
        match = robot.update(image, stamp)
        verdict = "accepted" if match.accepted else "not accepted"
        print(
            f"{since:8.2f} s  place {match.place:5d}  {match.name:24s}  {match.probability:4.0%}  {verdict}", flush=True
        )


if __name__ == "__main__":
    try:
        replay(arguments().parse_args())
    except LavaVprError as error:
        sys.exit(f"replay_bag: {error}")
    except (KeyboardInterrupt, BrokenPipeError):
        sys.exit(1)
