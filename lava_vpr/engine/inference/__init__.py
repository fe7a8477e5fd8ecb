"""The integer network that answers queries: its spec, its fast kernel, its quantisation, its inputs."""
