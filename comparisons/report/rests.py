"""What reports say of joints that stick."""

from __future__ import annotations

from collections.abc import Sequence


def sticking(joints: Sequence[int]) -> str:
    """Say that the rests of joints, from 0, were left out, and why."""
    return (
        f"Joints that stick: {', '.join(str(j + 1) for j in joints)}. Where they stand, dry friction holds whatever "
        "current the drive gives, and nothing can be learnt from it: these rows were left out, but for the errors on "
        "logs, which are given with and without them."
    )
