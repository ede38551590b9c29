"""What reports say of joints whose dry friction tells nothing for a while."""

from __future__ import annotations

from collections.abc import Sequence


def sticking(joints: Sequence[int]) -> str:
    """Say that the rests of joints, from 0, were left out, and why."""
    return (
        f"Joints that stick: {_listed(joints)}. Where they stand, dry friction holds whatever "
        "current the drive gives, and nothing can be learnt from it: these rows were left out, but for the errors on "
        "logs, which are given with and without them."
    )


def yielding(joints: Sequence[int]) -> str:
    """Say that what follows the turns of joints, from 0, was left out, and why."""
    return (
        f"Joints whose dry friction builds up over less than a milliradian as they turn round: {_listed(joints)}. "
        "A sign of velocity cannot follow that, and its errors would hide everything else: rows within a milliradian "
        "after a turn were left out, but for the errors on logs, which are given with and without them. A model of "
        "identify, which may take friction with hysteresis, learns from them."
    )


def _listed(joints: Sequence[int]) -> str:
    return ", ".join(str(joint + 1) for joint in joints)
