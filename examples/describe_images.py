"""Make a file of descriptors of a folder of images, to learn and ask instead of the images.

    python examples/describe_images.py summer/ -o summer.npz
    lava-vpr train summer.npz -o route.lvpr

Put your own network into `describe`; what stands there is OpenCV's HOG, so that this runs as it is.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr import LavaVprError
from lava_vpr.traverse import open_traverse

HOG = cv2.HOGDescriptor((64, 64), (16, 16), (8, 8), (8, 8), 9)


def describe(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """One image, uint8 (h, w, 3) BGR or (h, w) grey, to one row of numbers of a fixed length."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    found: Any = HOG.compute(cv2.resize(grey, (64, 64)))
    return np.asarray(found, np.float32).ravel()


def main() -> None:
    """Describe every image, and write the file."""
    parser = argparse.ArgumentParser(description="Make a file of descriptors of images.")
    parser.add_argument("images", help="a folder, list, video or ROS bag")
    parser.add_argument("-o", "--output", required=True, help="file to write (.npz)")
    said = parser.parse_args()
    try:
        drive = open_traverse(said.images)
        rows = np.stack([describe(image) for image in drive.images()])
        beside: dict[str, Any] = {"names": np.array(drive.names)}
        if drive.positions is not None:
            beside |= {"positions": drive.positions.values, "frame": np.array(drive.positions.frame)}
        np.savez(said.output, descriptors=rows, **beside)
    except (LavaVprError, OSError) as error:
        sys.exit(f"error: {error}")
    print(f"{len(rows)} descriptors of {rows.shape[1]:,} values: {said.output}")


if __name__ == "__main__":
    main()
