"""Import every module of the installed package (run from a folder outside the checkout)."""

import importlib
import pkgutil

import lava_vpr

names = ["lava_vpr"]
names += [m.name for m in pkgutil.walk_packages(lava_vpr.__path__, "lava_vpr.") if not m.name.endswith("__main__")]
for name in names:
    importlib.import_module(name)
for wanted in ("lava_vpr.processes.plastic_dense.models", "lava_vpr.deploy", "lava_vpr.cli.train"):
    if wanted not in names:
        raise SystemExit(f"the wheel lacks {wanted}")
print(f"imported {len(names)} modules from {lava_vpr.__file__}")
