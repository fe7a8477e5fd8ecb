"""The one way from references to a model, for Python, the command line and benchmarks."""
