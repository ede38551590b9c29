"""Step 6, settle or say so: which other names these data cannot tell from the one given, and what would."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.stats import wilcoxon

from ident.arrays import FloatArray
from ident.effects import load_catalogue
from ident.effects.ripple import GEAR_HARMONICS
from ident.gap.candidates import Trial, admissible, within_bounds
from ident.gap.experiment import Experiment
from ident.gap.joint_gap import JointGap, Named, nested_errors
from ident.gap.panel import Panel
from ident.gap.problem import JointProblem
from ident.gap.search import AT_REST

DOUBT = 0.01
"""Chance that a rival no worse than a name is beaten on held-out blocks of rows."""

LAW = 0.965
"""A rival that explains this share of what the name explains is not ruled out: no law is exact."""

BLOCKS = 60
"""Blocks of rows whose squared residuals are compared in pairs; longer than residuals remember."""

RIVALS = 8
"""Other names, best first, that are held against one; those after them explain far less."""

MOTIONS = {
    frozenset({"coulomb-asymmetry", "current-offset"}): ("torque_ramps", "slow torque ramps from rest"),
    frozenset({"viscous", "filter-lag"}): ("plateaus", "plateaus of several constant speeds"),
    frozenset({"delay", "rotor-inertia"}): ("fourier", "several frequencies at once, slow and fast"),
    frozenset({"delay", "filter-lag"}): ("fourier", "motion with quicker changes of current, up to the speed limit"),
    frozenset({"payload", "drive-gain"}): ("static_poses", "static poses with and without a known mass"),
    frozenset({"payload", "base-tilt"}): ("static_poses", "static poses all around the first axis"),
    frozenset({"stribeck", "sigmoid"}): ("plateaus", "plateaus of 1 to 50 mrad/s, both ways"),
    frozenset({"stribeck", "maxwell-slip"}): ("reversals", "small reversals: a loop in position, none in velocity"),
    frozenset({"sigmoid", "maxwell-slip"}): ("reversals", "small reversals: a loop in position, none in velocity"),
    frozenset({"sigmoid", "viscous-nonlinear"}): (
        "plateaus",
        "plateaus from a few mrad/s to the speed limit, both ways",
    ),
    frozenset({"load-friction", "torque-saturation"}): ("static_poses", "the same torque at +dq and at -dq"),
    frozenset({"cable-spring", "gravity-balancer"}): ("sinusoid", "the joint's whole range, slowly"),
    frozenset({"gear-ripple", "cogging"}): ("plateaus", "two slow constant speeds at two loads, and the gear ratio"),
    frozenset({"gear-ripple", "cable-spring"}): ("plateaus", "two slow constant speeds over the whole range"),
    frozenset({"thermal-friction", "sensor-drift"}): ("sinusoid", "minutes of motion both ways: heat follows sign(dq)"),
    frozenset({"maxwell-slip", "backlash"}): ("reversals", "small reversals under loads of both signs"),
}
"""Protocol, and in words, that tells two effects apart."""


def alternatives(panel: Panel, gap: JointGap, named: Sequence[Named], one: Named) -> dict[str, Trial | None]:
    """Names that the rows cannot tell from one of a joint's names, most likely first, with their fitted shapes.

    None stands for a name that no motion tells from it.
    """
    others = [n.trial for n in named if n is not one]
    problem = gap.problem(panel, others)
    before = problem.errors().total
    own = _held_out(panel, problem, one.trial, gap.joint)
    explained = before - float(own @ own)
    found: dict[str, Trial | None] = {}
    if one.effect.name in TWINS and _of_motor(panel, one.trial, gap.joint):
        found[TWINS[one.effect.name]] = None
    unasked = [load_catalogue()[name](gap.joint) for name in AT_REST if gap.sticks]
    found.update((other.name, None) for other in unasked if one.effect.rivals_with(other))
    taken = {n.effect.name for n in named}
    for tried in [t for t in one.ranking if t.effect.name != one.effect.name][:RIVALS]:
        if tried.effect.name in taken or tried.effect.name in found:
            continue
        rival = within_bounds(panel, problem, tried, gap.joint)
        left = _held_out(panel, problem, rival, gap.joint)
        gain = before - float(left @ left)
        if gain <= 0.5 * explained:
            continue
        close = gain >= LAW * explained or not _beats(own, left)
        if close and (one.effect.rivals_with(rival.effect) or _repeats(panel, gap, others, rival, explained)):
            found[rival.effect.name] = rival
    return found


TWINS = {"gear-ripple": "cogging", "cogging": "gear-ripple"}
"""The same columns: only the gear ratio tells one from the other, unless the ripple is one of whole motor turns."""

WHOLE = 0.01
"""Part of a motor turn that a ripple of its whole turns may be off by."""


def _of_motor(panel: Panel, ripple: Trial, joint: int) -> bool:
    """Whether a ripple may be the gear's as well as the poles': once or twice a turn of the motor, or who knows."""
    ratio = panel.robot.gear_ratio
    if ratio is None:
        return True
    turns = float(ripple.shape[0]) / max(abs(float(ratio[joint])), 1e-6)
    return abs(turns - round(turns)) <= WHOLE and 1 <= round(turns) <= GEAR_HARMONICS


def next_experiment(name: str, others: Iterable[str], experiments: Mapping[tuple[str, str], Experiment]) -> str | None:
    """Say which motions would separate a name from its alternatives, and those from each other; None if there are none.

    Args:
        name: the name.
        others: the alternatives.
        experiments: by pair of them all, the name first, the motion on which they differ most, where one is known.
    """
    catalogue = load_catalogue()
    said = []
    for (one, other), found in experiments.items():
        if not found.shows:
            said.append(f"no motion that was tried tells {one} from {other}")
            continue
        times = f"{found.ratio:.2g} times what is left"
        enough = "" if found.settles else ", the most of all motions tried, and too little to be sure of either law"
        said.append(f"{found.motion}: on it {one} and {other} differ by {times}{enough}")
    for other in others:
        if (name, other) in experiments:
            continue
        if frozenset({name, other}) in MOTIONS:
            protocol, words = MOTIONS[frozenset({name, other})]
            said.append(f"{protocol}: {words} ({name} or {other})")
        else:
            said.append(f"{catalogue[name].excitation}; {catalogue[other].excitation} ({name} or {other})")
    return "; ".join(dict.fromkeys(said)) or None


def _repeats(panel: Panel, gap: JointGap, others: Sequence[Trial], rival: Trial, explained: float) -> bool:
    """Whether a rival predicts half as much with its shape, too, found on other rows: a shape may fit by chance."""
    before, after = nested_errors(panel, gap, others, rival)
    return float(np.sum(before - after)) > 0.5 * explained


def _held_out(panel: Panel, problem: JointProblem, trial: Trial, joint: int) -> FloatArray:
    return problem.held_out(admissible(panel, problem, trial.effect, trial.shape, joint))


def _beats(own: FloatArray, rival: FloatArray) -> bool:
    """Whether squared residuals are smaller than a rival's beyond doubt, in a paired comparison of blocks.

    By signed ranks (Wilcoxon 1945): a motion that shows the difference in a few blocks shows it no less.
    """
    loss = np.array([part.sum() for part in np.array_split(rival**2 - own**2, BLOCKS)])
    return bool(loss.any() and wilcoxon(loss, alternative="greater").pvalue < DOUBT)
