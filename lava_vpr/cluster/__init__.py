"""How tasks are run: on threads here, or by the workers of a Dask cluster; either way with the same results."""
