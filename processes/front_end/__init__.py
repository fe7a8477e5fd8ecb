"""The spiking front end, from pixels to the spikes of its cells."""

PROCESSES = ("FrontEndNetwork",)
