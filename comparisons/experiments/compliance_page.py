"""Joint and task compliance as Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from comparisons.experiments.table_two_page import joint_table

AXES = ("fx [N]", "fy [N]", "fz [N]")


def compliance_page(result: Mapping[str, Any]) -> str:
    """Return the page of a result of `compliance`."""
    joint, task, unit, sizes = result["joint"], result["task"], result["unit"], result["sizes"]
    learned = (
        "trained before"
        if result["trained_before"]
        else f"{sizes['width']} neurons a layer, {sizes['epochs']} epochs on {sizes['seconds']:,.0f} s of stop-and-go "
        f"motion, discriminator on {sizes['signal']}"
    )
    parts = [
        "# Compliance on the virtual VS060\n",
        f"HRDL-MD: {learned}. GMO stands on the paper's model (sigmoid friction, no memory), the other on one with "
        "Maxwell slip. All residuals at 5 Hz. Deadzones are the greatest residuals of a log that nobody touches, so "
        "nothing less keeps the arm still.\n",
        f"## Deadzone [{unit}]\n",
        joint_table({name: list(zone) for name, zone in joint["deadzone"].items()}),
        "## Joint compliance\n",
        "![Residuals and command velocities](joint_compliance.png)\n",
        _rides(joint["rides"]),
        "## Greatest residual while nobody touches the arm\n",
        f"In the ride that HRDL-MD leads, [{unit}].\n",
        joint_table(_peaks(joint["rides"])),
        "## Task compliance\n",
        "![Forces at the tool](task_compliance.png)\n",
        _wrenches(task),
        f"The tool goes {1e3 * task['tool_way']:.0f} mm under up to {task['greatest_force']:.0f} N, turns by at most "
        f"{1e3 * task['tool_turned']:.0f} mrad, and travels {1e3 * task['travel_after_release']:.2f} mrad in a joint "
        f"when it is let go. Deadzone {', '.join(f'{v:.1f}' for v in task['deadzone'])} N; "
        f"{task['parameters']['compound']} weights in each scheme.\n",
        f"Networks are kept as they were when the validation log was told best: "
        f"{', '.join(f'{name} after epoch {kept}' for name, kept in task['kept_after_epoch'].items())}. After epoch 0 "
        "means that nothing learned from these logs held on another.\n",
        f"Made by `{result['provenance']['command_line']}`, {result['provenance']['date']}.\n",
    ]
    return "\n".join(parts)


def _rides(rides: Mapping[str, Any]) -> str:
    """For each ride the force at which each push moved the arm, how far it went, and what it did by itself."""
    episodes = next(iter(rides.values()))["episodes"]
    names = [f"link {' and '.join(map(str, episode['links']))}" for episode in episodes]
    head = f"| led by | {' | '.join(names)} | travel untouched [mrad] | untouched time moving [%] |"
    lines = [
        "Force at which the arm begins to yield [N] / way of the pushed points along the push [mm].\n",
        head,
        "|---|" + "---|" * len(names) + "---:|---:|",
    ]
    for name, one in rides.items():
        cells = [_yield(episode) for episode in one["episodes"]]
        still = one["untouched"]
        own = f"{1e3 * still['travel']:.2f} | {100 * still['moving_share']:.1f}"
        lines.append(f"| {name} | {' | '.join(cells)} | {own} |")
    return "\n".join(lines) + "\n"


def _yield(episode: Mapping[str, Any]) -> str:
    way = ", ".join(f"{1e3 * one:.0f}" for one in episode["yielded"])
    force = episode["force_at_start"]
    return f"none / {way}" if force is None else f"{force:.0f} / {way}"


def _peaks(rides: Mapping[str, Any]) -> dict[str, Sequence[float]]:
    first = next(iter(rides.values()))
    return {name: list(peak) for name, peak in first["untouched"]["peak"].items()}


def _wrenches(task: Mapping[str, Any]) -> str:
    lines = [f"| RMSE of the force | {' | '.join(AXES)} |", "|---|" + "---:|" * len(AXES)]
    for key, title in (("ride", "led by the hand"), ("test", "pushes on a log")):
        for scheme, values in {"no estimate at all": task[f"rms_{key}"], **task[f"rmse_{key}"]}.items():
            lines.append(f"| {scheme}, {title} | {' | '.join(f'{v:.2f}' for v in np.asarray(values)[:3])} |")
    return "\n".join(lines) + "\n"
