"""Functions that run in a child process, which can be killed when Lava hangs."""
