"""The error of the simulation that a user can mend."""

from __future__ import annotations


class SimulationError(ValueError):
    """One line that names the option and the remedy."""
