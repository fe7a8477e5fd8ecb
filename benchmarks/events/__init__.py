"""Event cameras: how their settings were chosen, and what they reach on LENS's example and on synthetic drives."""
