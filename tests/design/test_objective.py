"""Goals, penalties and limits against their definitions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import jaxpound as jp
from jaxpound import Objective
from jaxpound.design import LeastDemand, Limit
from jaxpound.design.goals import gathered, tail_mean
from tests.refusals import refusals

GAPS = np.random.default_rng(0).normal(0.3, 0.2, 50)
REST = np.full(50, 1.0)


def goal(which, gaps=GAPS):
    return float(which(jnp.asarray(gaps), jnp.ones(len(gaps))))


def test_goals_are_their_definitions():
    assert goal(jp.SmallestGap()) == pytest.approx(GAPS.mean())
    assert goal(jp.SmallestGap("worst")) == GAPS.min()
    assert goal(jp.design.GapAtRest()) == -1.0
    soft = -0.1 * np.log(np.mean(np.exp(-GAPS / 0.1)))
    assert goal(jp.design.SoftMinimum(0.1)) == pytest.approx(soft)
    assert goal(jp.design.SoftMinimum(1e-4)) == pytest.approx(GAPS.min(), abs=1e-3)
    assert goal(jp.design.SoftMinimum(1e4)) == pytest.approx(GAPS.mean(), abs=1e-4)
    gaps = stats.norm.ppf((np.arange(200_000) + 0.5) / 200_000)
    expected = -stats.norm.pdf(stats.norm.ppf(0.1)) / 0.1
    assert goal(jp.SmallestGap(0.1), gaps) == pytest.approx(expected, abs=1e-4)
    # Rockafellar and Uryasev: of losses l the smallest of c + mean(max(l − c, 0)) / share over c.
    for share in (0.1, 0.13, 0.5, 0.999, 0.001):
        values = [c + np.mean(np.maximum(-GAPS - c, 0)) / share for c in -GAPS]
        assert -goal(jp.SmallestGap(share)) == pytest.approx(min(values), rel=1e-12)
    required = REST - GAPS
    for gap in (0.5, 0.7, 0.9):
        assert goal(jp.PoundingProbability(gap, width=1e-6)) == -np.mean(required >= gap)
    assert goal(jp.PoundingProbability(width=1e-6)) == -np.mean(GAPS <= 0)
    width = 1.06 * required.std() * 50**-0.2
    smooth = -np.mean(stats.norm.cdf((required - 0.7) / width))
    assert goal(jp.PoundingProbability(0.7)) == pytest.approx(smooth)


def slope_of(which, gaps=GAPS, rest=REST):
    return jax.jit(jax.grad(lambda gaps: which(gaps, jnp.asarray(rest))))(jnp.asarray(gaps))


GOALS = [*map(jp.SmallestGap, ("mean", "worst", 0.13)), jp.design.SoftMinimum(0.1)]


@pytest.mark.parametrize("which", [*GOALS, jp.PoundingProbability(0.7, 0.1)])
def test_derivatives_of_goals_against_differences(which):
    slope = slope_of(which)
    for i in (0, int(np.argmin(GAPS)), 17):
        step = 1e-6 * np.eye(50)[i]
        difference = (goal(which, GAPS + step) - goal(which, GAPS - step)) / 2e-6
        assert float(slope[i]) == pytest.approx(difference, abs=1e-8)


def test_silverman_s_width_has_no_derivative_of_its_own():
    which = jp.PoundingProbability(0.7)
    width = 1.06 * (REST - GAPS).std() * 50**-0.2
    expected = stats.norm.pdf((REST - GAPS - 0.7) / width) / width / 50
    np.testing.assert_allclose(slope_of(which), expected)
    assert np.isfinite(slope_of(which, np.full(3, 0.3), np.ones(3))).all()


def test_an_objective_is_goal_less_penalties_and_its_limits_are_prices():
    x, last = jnp.asarray(GAPS), np.sort(GAPS)
    assert float(gathered(x, "mean")) == pytest.approx(GAPS.mean())
    assert float(gathered(x, "worst")) == GAPS.max()
    assert float(gathered(x, 0.1)) == pytest.approx(last[-5:].mean())
    assert float(tail_mean(x, 0.05)) == pytest.approx(np.sum(last[-3:] * [0.5, 1, 1]) / 2.5)
    objective = Objective(
        penalties={"peak_f1": 0.5, "peak_x1": jp.design.Penalty(2.0, "worst")},
        limits={"damper_force": 0.3, "peak_f1": Limit(0.4, "mean")},
    )
    f, x = np.abs(GAPS), np.abs(GAPS) / 3
    columns = {"min_gap": GAPS, "initial_gap": REST, "peak_f1": f, "peak_x1": x}
    columns = {k: jnp.asarray(v) for k, v in columns.items()} | {"damper_force": jnp.full(50, 0.2)}
    value = float(objective.value(columns))
    assert value == pytest.approx(GAPS.mean() - 0.5 * f.mean() - 2 * x.max())
    np.testing.assert_allclose(objective.limited_demands(columns), [0.2, f.mean()])
    assert objective.limits["damper_force"] == Limit(0.3, "worst")
    demands = {"peak_drift": jnp.asarray(np.abs(GAPS))}
    for over in ("mean", "worst", 0.1):
        objective = Objective(LeastDemand("peak_drift", over))
        expected = float(gathered(demands["peak_drift"], over))
        assert -float(objective.value(demands)) == objective.size(demands) == expected
    assert (objective.demand, objective.quantity) == ("peak_drift", "length")
    assert Objective(LeastDemand("peak_acceleration_2")).quantity == "acceleration"
    assert objective.size({"peak_drift": jnp.zeros(3)}) == 1.0
    assert objective.limited_demands(demands).shape == (0,)


NEGATIVE = "total_damper_force = -1 must be positive and fin"
MEANT = r"unknown demand 'total_damper'.* mean 'total_damper_f"
test_bad_objectives_are_named = refusals(
    (lambda: jp.design.SoftMinimum(0.0), "temperature = 0 must be positive"),
    (lambda: jp.SmallestGap(1.0), "SmallestGap: over = 1 must be between 0 and 1"),
    (lambda: jp.PoundingProbability(-0.1), "gap = -0.1 must be finite and not negative"),
    (lambda: jp.PoundingProbability(0.1, 0.0), "width = 0 must be positive"),
    (lambda: LeastDemand("peak_drft"), "LeastDemand: unknown demand 'peak_drft'; did you mea"),
    (lambda: LeastDemand("min_gap"), "LeastDemand: unknown demand 'min_gap'"),
    (lambda: LeastDemand("peak_x1", "all"), "LeastDemand: over = 'all' must be 'worst', "),
    (lambda: Limit(0.0), "at_most = 0 must be positive"),
    (lambda: Limit(1.0, "median"), "over = 'median' must be 'worst', 'mean' or a share"),
    (lambda: Limit(1.0, 2.0), "over = 2 must be between 0 and 1"),
    (lambda: jp.design.Penalty(-1.0), "weight = -1 must be finite and not negative"),
    (lambda: Objective(jp.SmallestGap), "goal = .* must be a function"),
    (lambda: Objective("gap"), "goal = 'gap' must be a function"),
    (lambda: Objective(limits={"peak_g1": 1.0}), "unknown demand 'peak_g1' in limits; did"),
    (lambda: Objective(limits={"total_damper_force": -1.0}), NEGATIVE),
    (lambda: Objective(limits={"total_damper": 1.0}), MEANT),
    (lambda: Objective(limits={"peak_f1": "low"}), "peak_f1 = 'low' must be a real number"),
)
