"""Gains of inputs as synapses, and the neurons that add up what comes through them."""

PROCESSES = ("InputGains",)
