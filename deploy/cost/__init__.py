"""What a query costs on the chip: counted events, and the energy and time of those."""
