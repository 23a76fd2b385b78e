"""The error of this stage that a user can mend."""

from __future__ import annotations


class OdometryError(ValueError):
    """Odometry that cannot be used; one line naming the file, the field and the remedy."""
