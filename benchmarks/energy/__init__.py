"""All the energy of a query, on a board and without one."""
