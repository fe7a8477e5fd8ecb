"""Learning by gradients through spikes, with lava-dl's SLAYER; the only room that imports torch, and only to learn."""
