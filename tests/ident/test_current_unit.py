"""A log whose current is in another unit than a model's."""

import re

import numpy as np
import pytest

from ident.current_unit import check_unit
from ident.effects.electrical import CurrentOffset
from ident.effects.friction import Coulomb, Viscous
from ident.effects.rigid_body import Links
from ident.errors import InputError
from ident.fit import Drives, fit
from ident.gap.workflow import find_gap
from ident.identification import identify


@pytest.fixture(scope="module")
def model(vs060, recorded):
    effects = [kind(j) for j in range(6) for kind in (Links, Coulomb, Viscous, CurrentOffset)]
    return fit(vs060, effects, [recorded(40.0, 1)], 10.0, Drives(np.ones(6), "%Use")).model


@pytest.mark.parametrize("factor", [1e3, 1e-3, 100.0, 0.01])
def test_currents_in_another_unit_are_refused(factor, model, recorded):
    right = recorded(seed=2)
    odd = right.replace(current=factor * right.current, name="odd")
    told = re.escape(f"i1 to i6 hold about {factor:.3g} times what the model predicts")
    with pytest.raises(InputError, match=f"{told}: another unit than its %Use, odd row 1, multiply scale current"):
        check_unit(model, [right, odd])


@pytest.mark.parametrize("factor", [0.1, 1.0, 10.0])
def test_a_robot_that_has_changed_is_none(factor, model, recorded):
    log = recorded(seed=2)
    check_unit(model, [log.replace(current=factor * log.current)])


def test_noise_and_rest_have_no_unit(model, recorded):
    log = recorded(seed=2)
    noise = np.random.default_rng(0).normal(size=log.current.shape)
    check_unit(model, [log.replace(current=1e4 * noise), log.replace(current=1e4 * noise + 1e-2 * log.current)])
    check_unit(model, [log.replace(q=np.tile(log.q[:1], (len(log), 1)), current=1e3 + noise)])


def test_a_few_joints_that_differ_are_no_other_unit(model, recorded):
    log = recorded(seed=2)
    check_unit(model, [log.replace(current=log.current * [1e3, 1e3, 1.0, 1.0, 1.0, 1.0])])


def test_one_log_of_another_unit_is_refused_by_all_that_learns(vs060, model, recorded):
    logs = [recorded(seed=2), recorded(seed=3)]
    logs[1] = logs[1].replace(current=1e3 * logs[1].current)
    with pytest.raises(InputError, match=r"currents are .* times those of .*, give all logs in one unit"):
        identify(vs060, logs, effects=["coulomb", "viscous"], cutoff=10.0)
    for train, test in (([logs[0]], [logs[1]]), ([logs[1]], [])):
        with pytest.raises(InputError, match="hold about 1e\\+03 times what the model predicts"):
            find_gap(model, train, test, refit=False)
