"""lava-vpr: visual place recognition with spiking networks on Intel's Loihi."""

from lava_vpr import kernelcache

__version__ = "0.1.0"

kernelcache.prepare()
