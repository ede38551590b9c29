"""Identify arms whose joints stick: errors in motion over the noise, with the rests learnt from and left out.

Run ``python benchmarks/identify_sticking.py``; prints a Markdown table. The logs are those of the hidden-effect
benchmark's style ``sticks`` with nothing hidden: a joint that stands holds a level of current drawn anew for every
rest.
"""

from collections.abc import Sequence

import numpy as np

from comparisons.hidden_effects.cases import Case, Made, make
from ident.arrays import FloatArray
from ident.fit import fit
from ident.gap.evidence import evidence
from ident.gap.rests import Rests
from ident.identification import identify
from ident.model import CurrentModel
from ident.start import start_of
from ident.structure import choose_structure

ROBOTS = ("ur10", "panda", "xarm7", "vs060")
SEED = 81
USUAL = ("links", "rotor-inertia", "current-offset", "coulomb", "viscous")


def learnt_from_rests(made: Made) -> CurrentModel:
    """What `identify` would find if rests were rows like others."""
    start = start_of(made.robot, made.train)
    chosen = choose_structure(made.robot, start.effects, made.train, start.cutoff.hertz, start.drives)
    return fit(made.robot, chosen.effects, made.train, start.cutoff.hertz, start.drives).model


def in_motion(model: CurrentModel, made: Made, rests: Rests) -> FloatArray:
    """RMS error (n,) in motion on the test log over the noise."""
    return evidence([model], made.test, rests).moving[0] / made.noise


def taken(model: CurrentModel) -> int:
    """Number of friction terms beyond Coulomb and viscous friction; there is nothing else to be found."""
    return sum(term.effect.name not in USUAL for term in model.terms)


def spread(errors: Sequence[float]) -> str:
    return f"{np.median(errors):.2f} ({np.min(errors):.2f} to {np.max(errors):.2f})"


def main() -> None:
    print("| robot | error in motion over the noise, rests learnt from | left out | terms taken, before | after |")
    print("|---|---|---|---|---|")
    for number, name in enumerate(ROBOTS):
        made = make(Case(name, (), SEED + number, style="sticks"))
        found, before = identify(made.robot, made.train), learnt_from_rests(made)
        errors = [spread(in_motion(model, made, found.rests).tolist()) for model in (before, found.model)]
        print(f"| {name} | {errors[0]} | {errors[1]} | {taken(before)} | {taken(found.model)} |", flush=True)


if __name__ == "__main__":
    main()
