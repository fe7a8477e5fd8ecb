"""`lava-vpr bench`: what a query costs, measured here and modelled for the chips, with recall beside it."""
