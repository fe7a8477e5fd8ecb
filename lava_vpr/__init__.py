"""lava-vpr: visual place recognition with spiking networks on Intel's Loihi."""

__version__ = "0.1.0"
