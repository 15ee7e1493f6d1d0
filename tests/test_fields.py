"""What fields say of themselves: rules and their words by path, known or traced."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

import jaxpound as jp
from jaxpound._checks import all_hold, enforce
from jaxpound._fields import Parameter, parameter, part, pytree_dataclass, rules, walk
from tests.refusals import refused


@pytree_dataclass
class Material:
    order: object = parameter(above=0, most=1, default=0.5)
    share: object = parameter(least=0, most=1, default=0.5)
    free: object = parameter(default=-3.0)
    size: object = parameter(above=0, default=1.0)
    gap: object = parameter(least=0, finite=False, default=np.inf)
    low: object = parameter(above=0, default=1.0)
    high: object = parameter(above="low", default=2.0)
    least: object = parameter(least="low", why="by law", default=1.0)


@pytree_dataclass
class Frame:
    one: Material = part(Material)
    more: tuple = part(Material, each=True)
    weights: tuple = parameter("w", least=0, each=True)


FRAME = Frame(Material(), (Material(), Material(size=2)), (0.0, 1.0))


def test_rules_have_ends_and_are_named_by_their_paths_and_traced_to_flags():
    Material(order=1, share=0, gap=0, least=1.0, high=np.nextafter(1, 2))
    assert Material(order=1).order == 1.0
    refused(r"Frame: weights\.1 = -1 must be finite and not nega", Frame, Material(), (), (0.0, -1))
    refused(r"Frame: more\.1 = 3 must be of type Material", Frame, Material(), (Material(), 3), ())
    refused(r"Frame: one = None must be of type Material", Frame, None, (), ())
    names = [rule.name for rule in rules(FRAME)]
    assert {name for name in names if name.startswith("more.1.")} == {
        f"more.1.{field.name}" for field in dataclasses.fields(Material)
    }
    assert names[-2:] == ["weights.0", "weights.1"]
    assert all(rule.holds for rule in rules(FRAME))
    broken = jax.tree.unflatten(jax.tree.structure(FRAME), [-1.0] * len(jax.tree.leaves(FRAME)))
    refused(r"^enforce: here\.one\.order = -1 must be in", enforce, rules(broken, "here."))
    paths = [path for path, _, _ in walk(FRAME, Parameter)]
    assert [rule.name for rule in rules(FRAME)] == paths

    @jax.jit
    def valid(low, least):
        return all_hold(rules((Material(low=low, high=5.0, least=least),)))

    flags = [bool(valid(*ends)) for ends in ((1.0, 1.0), (1.0, 0.5), (2.0, 1.0))]
    assert flags == [True, False, False]
    flags = jax.vmap(valid, (None, 0))(1.0, jnp.array([0.5, 1.0, jnp.nan, jnp.inf]))
    np.testing.assert_array_equal(flags, [False, True, False, False])


def test_numbers_of_numpy_are_shown_as_pythons():
    building = jp.Building(np.float64(5e5), np.float32(2.5), np.int64(1), 0.25, np.float64(0.5))
    numbers = "mass=500000.0, stiffness=2.5, order=1.0, tau_f=0.25, tau_x=0.5"
    assert repr(building) == f"Building({numbers}, hysteresis=None, dashpot=None)"
    assert repr(jp.LogNormal(np.float64(2), 0.5)) == "LogNormal(median=2.0, sigma=0.5)"
    assert "float64" not in repr(jp.Storeys((np.float64(1.0),), jp.Rod(jp.ZenerRod(1, 1, 1), 1.0)))
