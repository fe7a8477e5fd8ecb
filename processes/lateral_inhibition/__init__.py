"""Inhibition of all others."""

PROCESS = "LateralInhibition"
