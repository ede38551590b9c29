"""What reports say of joints whose dry friction tells nothing for a while."""

from __future__ import annotations

from collections.abc import Sequence

from ident.arrays import FloatArray


def sticking(joints: Sequence[int]) -> str:
    """Say that the rests of joints, from 0, were left out, and why."""
    return (
        f"Joints that stick: {_listed(joints)}. Where they stand, dry friction holds whatever "
        "current the drive gives, and nothing can be learnt from it: these rows were left out, but for the errors on "
        "logs, which are given with and without them."
    )


def yielding(lengths: FloatArray) -> str:
    """Say over which displacements (n,) the dry friction of joints builds up."""
    said = ", ".join(f"{j + 1} ({1e3 * length:.2g})" for j, length in enumerate(lengths) if length > 0.0)
    return (
        f"Joints that yield before they slip, with the displacement in mrad (mm) over which their dry friction builds "
        f"up as they turn round: {said}. The model's friction does so, and holds where a joint stops."
    )


def _listed(joints: Sequence[int]) -> str:
    return ", ".join(str(joint + 1) for joint in joints)
