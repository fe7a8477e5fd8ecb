"""Custom Lava Processes, one folder each with ``process.py`` and ``models.py`` (import as `lava_vpr.processes`)."""
