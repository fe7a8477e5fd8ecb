"""Long routes at a Dask cluster: time, bytes between machines, memory."""
