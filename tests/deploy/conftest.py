"""The stand-in board of the tests of deployment."""

from support.boards.kapoho_board import board  # noqa: F401
