"""Stand-in: Lava takes lava-loihi for installed where this module is."""
