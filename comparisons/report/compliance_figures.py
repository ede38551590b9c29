"""Figures of a compliant arm: what is felt, the deadzone, and the velocity commanded."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from comparisons.report import style
from ident.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from comparisons.experiments.compliant import Ride
    from comparisons.virtual_robot.contact import Push
    from ident.robot import Robot

COMMAND = style.RESIDUAL
LINES = (style.PREDICTED, style.FURTHER[0], style.MEASURED)
"""Colours of the estimators in their order."""

AXES = ("x", "y", "z")


def joint_compliance(
    robot: Robot, ride: Ride, boundary: FloatArray, pushes: Sequence[Push], shown: Sequence[str] | None = None
) -> Figure:
    """Residuals of each joint against its deadzone, with the velocity commanded on an axis of its own.

    Args:
        robot: the robot.
        ride: what happened.
        boundary: of the deadzone, (n,).
        pushes: shaded.
        shown: estimators, all unless told.
    """
    figure, axes = style.joint_grid(robot.joints, "time [s]", f"residual [{robot.unit}]", height=1.9)
    t, names = ride.log.t, list(ride.felt) if shown is None else list(shown)
    fastest = 1.15 * max(float(np.abs(ride.command).max()), 1e-3)
    with style.report_style():
        for joint, axis in enumerate(axes):
            _shade(axis, pushes)
            for name, colour in zip(names, LINES, strict=False):
                axis.plot(*style.thin(t, ride.felt[name][:, joint], 1600), color=colour, label=name)
            for sign in (1.0, -1.0):
                label = "deadzone" if sign > 0.0 else None
                axis.axhline(sign * boundary[joint], color=style.INK, linestyle="--", linewidth=0.8, label=label)
            top = 1.15 * max(boundary[joint], *(float(np.abs(ride.felt[name][:, joint]).max()) for name in names))
            axis.set_ylim(-top, top)
            axis.plot([], [], color=COMMAND, label="command")
            speed = axis.twinx()
            speed.plot(*style.thin(t, ride.command[:, joint], 1600), color=COMMAND, linewidth=0.9)
            speed.set_ylim(-fastest, fastest)
            speed.grid(visible=False)
            speed.spines["right"].set_visible(True)
            speed.tick_params(colors=COMMAND)
            if joint % 2 or joint == len(axes) - 1:
                speed.set_ylabel("command [rad/s]", color=COMMAND)
        style.legend_above(figure, axes[0])
    return figure


def task_compliance(ride: Ride, boundary: FloatArray) -> Figure:
    """Forces at the tool: true, as each model gives them, and the speed of the fastest joint commanded."""
    assert ride.log.wrench is not None
    figure = style.new_figure(9.0, 5.6)
    t = ride.log.t
    with style.report_style():
        axes = figure.subplots(4, 1, sharex=True)
        for k, axis in enumerate(axes[:3]):
            axis.plot(t, ride.log.wrench[:, k], color=style.MEASURED, label="true", linewidth=1.4)
            for (name, felt), colour in zip(ride.felt.items(), (style.PREDICTED, *style.FURTHER), strict=False):
                axis.plot(*style.thin(t, felt[:, k], 2400), color=colour, label=name, linewidth=0.9)
            for sign in (1.0, -1.0):
                label = "deadzone" if sign > 0.0 else None
                axis.axhline(sign * boundary[k], color=style.INK, linestyle="--", linewidth=0.8, label=label)
            axis.set_ylabel(f"force {AXES[k]} [N]")
        axes[3].plot(*style.thin(t, np.abs(ride.command).max(axis=1), 2400), color=COMMAND)
        axes[3].set_ylabel("fastest joint\n[rad/s]")
        axes[3].set_xlabel("time [s]")
        style.legend_above(figure, axes[0])
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, on white paper, and as SVG; ``path`` is without suffix."""
    with style.report_style():
        figure.savefig(path.with_suffix(".png"), dpi=130, facecolor="white")
        figure.savefig(path.with_suffix(".svg"), facecolor="white")


def _shade(axis: Axes, pushes: Sequence[Push]) -> None:
    for push in pushes:
        axis.axvspan(push.start, push.start + push.duration, color=style.FURTHER[3], alpha=0.15, linewidth=0)
