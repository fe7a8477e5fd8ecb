"""Whole runs of Lava as functions of arrays, called in a child process."""
