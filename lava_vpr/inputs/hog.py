"""HOG: histograms of oriented gradients, the classical descriptor that the baseline ``hog`` compares.

Source: Dalal and Triggs, CVPR 2005 (doi 10.1109/CVPR.2005.177), as OpenCV computes it with the settings that it comes
with: 9 directions, cells of 8 x 8 pixels, blocks of 2 x 2 cells a cell apart, no gamma correction. Nothing is tuned.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from lava_vpr.inputs.patches import grey

HOG_SIDE = 64
"""Side in pixels of the square grey image that is described; VPRSNN, VPRTempo and ours see 28, 56 and 64."""
HOG_VALUES = 1764
"""Values of a descriptor: 7 x 7 blocks of 4 cells with 9 directions."""

_HOG = cv2.HOGDescriptor((HOG_SIDE, HOG_SIDE), (16, 16), (8, 8), (8, 8), 9)


def hog(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The descriptor of an ``image`` (h, w) or (h, w, 3) BGR, uint8 (1764,).

    The image is resized as the paper's input is (bilinear, then grey). Values, which OpenCV gives in 0..1, are rounded
    to 1/255, so that a model file keeps a byte of each and cosines are the same bits on every machine.
    """
    values = np.asarray(_HOG.compute(grey(image, HOG_SIDE, cv2.INTER_LINEAR))).ravel()
    return np.rint(np.float32(255) * values).astype(np.uint8)
