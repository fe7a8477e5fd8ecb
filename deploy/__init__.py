"""From a model to what a board runs: partition, bundle, drivers (import as `lava_vpr.deploy`)."""
