"""Import every module of the installed package (run from a folder outside the checkout).

Without Lava its Processes are left out, and nothing else.
"""

import importlib
import pkgutil

import lava_vpr

names = ["lava_vpr"]
names += [m.name for m in pkgutil.walk_packages(lava_vpr.__path__, "lava_vpr.") if not m.name.endswith("__main__")]
left_out = []
for name in names:
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "lava" or not name.startswith("lava_vpr.processes."):
            raise
        left_out.append(name)
for wanted in ("lava_vpr.processes.plastic_dense.process", "lava_vpr.deploy", "lava_vpr.cli.train"):
    if wanted not in names:
        raise SystemExit(f"the wheel lacks {wanted}")
without = f" ({len(left_out)} that need Lava are left out)" if left_out else ""
print(f"imported {len(names) - len(left_out)} modules{without} from {lava_vpr.__file__}")
