"""The built-in synthetic world, drawn without any file."""

from lava_vpr.synthetic.world import write_traverses

__all__ = ["write_traverses"]
