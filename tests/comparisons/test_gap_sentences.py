"""What the report and the command line say of findings, in sentences."""

from types import SimpleNamespace

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
