"""The search of shape parameters in the gap workflow, and what counts as its bounds."""

import numpy as np
import pytest

from ident.effects.base import Shape
from ident.effects.ripple import GearRipple
from ident.gap.candidates import at_bound
from ident.gap.climb import climb


@pytest.mark.parametrize(("value", "bound"), [(4.0, True), (4.03, True), (5.96, False), (248.0, True), (100.0, False)])
def test_few_repeats_of_hundreds_are_at_no_bound(value, bound):
    ripple = GearRipple(0, most=250.0, fewest=4.0)
    assert at_bound(ripple, np.array([value])) is bound


def test_shapes_that_are_bound_to_one_another_are_searched_together():
    shapes = [Shape("lever", "1", 0.1, 0.98, (0.5, 0.75), log=False), Shape("speed", "1", 1e-3, 1.0, (0.1,))]

    def valley(shape):
        lever, speed = shape[0] - 0.3, np.log(shape[1] / 0.02)
        return 10.0 - 1e3 * (speed + 8.0 * lever) ** 2 - lever**2

    found, value = climb(valley, shapes, [(np.array([0.5, 0.1]), valley(np.array([0.5, 0.1])))])
    assert value == valley(found)
    np.testing.assert_allclose(found, [0.3, 0.02], rtol=0.05)


def test_shapes_are_searched_on_either_side_of_a_negative_start():
    ratio = Shape("ratio", "1", -2.0, 2.0, (1.0, -1.0), log=False)
    for best in (-1.4, -0.7):
        (found,), _ = climb(lambda shape, best=best: -((shape[0] - best) ** 2), [ratio], [(np.array([-1.0]), -1.0)])
        assert found == pytest.approx(best, abs=0.01)


def test_of_several_starts_what_the_best_leads_to_is_found():
    shapes = [Shape(name, "1", -3.0, 3.0, (-2.0, 0.0, 2.0), log=False) for name in ("place", "width")]

    def two_hills(shape):
        low, high = (np.sum((shape - top) ** 2) for top in ((-2.0, 0.5), (1.5, -1.0)))
        return max(1.2 - low, 2.0 - high)

    starts = [np.array([-2.0, 0.0]), np.array([2.0, 0.0])]
    assert two_hills(starts[0]) > two_hills(starts[1])
    found, value = climb(two_hills, shapes, [(start, two_hills(start)) for start in starts])
    np.testing.assert_allclose(found, [1.5, -1.0], atol=0.01)
    assert value == two_hills(found)
