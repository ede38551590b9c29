"""What the report and the command line say of findings, in sentences."""

from types import SimpleNamespace

import numpy as np
import pytest

from comparisons.report.gap import nameless, sentence
from ident.effects.hysteresis import Backlash
from ident.gap import Finding, Unexplained


@pytest.mark.parametrize(
    ("signal", "words"),
    [
        ("load5 (its size)", "it follows load5 (its size): it is larger where that changes sides"),
        ("|dq2| (its size)", "it follows |dq2| (its size): it is larger in slow motion."),
        ("dq2^2 (its size)", "it follows dq2^2 (its size): it is larger in fast motion."),
        ("load5", "it follows load5."),
    ],
)
def test_it_is_said_what_a_size_that_follows_a_signal_means(signal, words):
    assert words in nameless(Unexplained((4,), (signal,), 0.4))


@pytest.mark.parametrize(("slides", "unit"), [(True, "m"), (False, "rad")])
def test_displacements_have_the_unit_of_their_joint(slides, unit):
    found = SimpleNamespace(
        model=SimpleNamespace(unit_of=lambda effect, parameter: parameter.unit.replace("{angle}", unit)),
        evidence=None,
    )
    terms = (SimpleNamespace(effect=Backlash(1)),)
    play = Finding("backlash", "hysteresis", (1,), {"gap": 5e-5, "share": 0.9}, 1e-6, (), None, terms, 0.4)
    assert f"(backlash; gap 5e-05 {unit}, share 0.9)" in sentence(found, play)


def test_a_negative_delay_is_early_and_joints_that_it_harms_are_named():
    late, early = (
        Finding("delay", "timing", (), {"seconds": x}, 1e-3, (), None, (), 0.2) for x in (0.006, -0.006)
    )  # fmt: skip
    evidence = SimpleNamespace(steps=np.array([[1.0, 1.0, 1.0], [0.9, 0.9, 0.9], [0.8, 1.0, 0.9]]))
    found = SimpleNamespace(
        model=SimpleNamespace(unit="A", unit_of=lambda effect, parameter: parameter.unit),
        findings=(late, early), evidence=evidence, rests=(), noise_floor=np.full(3, 0.5),
    )  # fmt: skip
    assert "the current comes late" in sentence(found, late)
    assert "rises" not in sentence(found, late)
    assert "the current comes early, or the positions late" in sentence(found, early)
    assert sentence(found, early).endswith("from 0.9 to 0.8 A on joint 1, noise floor 0.5, and rises on joint 2.")
