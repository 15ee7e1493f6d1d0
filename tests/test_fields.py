"""What fields say of themselves: rules and their words by path, known or traced."""

import dataclasses
from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound._checks import all_hold, enforce
from jaxpound._fields import (
    Checked,
    Parameter,
    Quantity,
    like,
    parameter,
    part,
    pytree_dataclass,
    quantity,
    rules,
    walk,
)
from tests.refusals import refusals, refused


@pytree_dataclass
class Material:
    """Every kind of rule."""

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
    """Objects in objects, and in tuples."""

    one: Material = part(Material)
    more: tuple = part(Material, each=True)
    weights: tuple = parameter("w", least=0, each=True)


@dataclasses.dataclass(frozen=True)
class Plain(Checked):
    """No pytree, with one number, and a part that may be missing."""

    size: float = parameter(above=0, single=True)
    inner: Material | None = part(Material, type(None), default=None)


@pytree_dataclass
class Copy:
    """Has a parameter of another class."""

    low: object = parameter(above=0)
    least: object = like(Material, "least")


@runtime_checkable
class Holder(Protocol):
    """A kind by what it can do."""

    def hold(self):
        """Nothing."""


class Hook:
    """Holds, and is no pytree."""

    def hold(self):
        pass


@pytree_dataclass
class Peg(Hook):
    size: object = parameter(above=0)


@pytree_dataclass
class Wall:
    """Has a part that may be missing, and if not is traced."""

    held: Holder | None = part(Holder, Peg, type(None), traced=True, default=None)


@pytree_dataclass
class Other:
    """Has a part of another class."""

    held: object = like(Wall, "held", default=None)


FRAME = Frame(Material(), (Material(), Material(size=2)), (0.0, 1.0))

test_a_broken_rule_is_told_by_object_field_value_and_rule = refusals(
    ({"order": 0}, r"Material: order = 0 must be in \(0, 1\]$"),
    ({"order": 1.5}, r"order = 1\.5 must be in \(0, 1\]$"),
    ({"order": np.nan}, r"order = nan must be in \(0, 1\]$"),
    ({"share": -0.1}, r"share = -0\.1 must be between 0 and 1$"),
    ({"free": np.inf}, "free = inf must be finite$"),
    ({"size": 0.0}, "size = 0 must be positive and finite$"),
    ({"size": [1.0, -2.0]}, r"size = -2 \(at index \[1\]\) must be positive and finite$"),
    ({"size": "wide"}, "Material: size = 'wide' must be a real number"),
    ({"gap": -1.0}, "gap = -1 must be not negative$"),
    ({"gap": np.nan}, "gap = nan must be not negative$"),
    ({"high": 1.0}, "high = 1 must be finite and above low = 1$"),
    ({"low": 3.0}, "high = 2 must be finite and above low = 3$"),
    ({"least": 0.5}, r"least = 0\.5 must be finite and at least low = 1 \(by law\)$"),
    ({"low": 1.5}, r"least = 1 must be finite and at least low = 1\.5 \(by law\)$"),
    of=lambda changes: Material(**changes),
)


def test_rules_have_ends_and_are_named_by_their_paths_and_traced_to_flags():
    Material(order=1, share=0, gap=0, least=1.0, high=np.nextafter(1, 2))
    assert Material(order=1).order == 1.0
    with pytest.raises(ValueError, match=r"Frame: weights\.1 = -1 must be finite and not negative"):
        Frame(Material(), (), (0.0, -1))
    refused(r"Frame: more\.1 = 3 must be of type Material", Frame, Material(), (Material(), 3), ())
    refused(r"Frame: one = None must be of type Material", Frame, None, (), ())
    names = [rule.name for rule in rules(FRAME)]
    assert {name for name in names if name.startswith("more.1.")} == {
        f"more.1.{field.name}" for field in dataclasses.fields(Material)
    }
    assert names[-2:] == ["weights.0", "weights.1"]
    assert all(rule.holds for rule in rules(FRAME))
    broken = jax.tree.unflatten(jax.tree.structure(FRAME), [-1.0] * len(jax.tree.leaves(FRAME)))
    refused(r"^owner: here\.one\.order = -1 must be in", enforce, "owner", rules(broken, "here."))
    paths = [path for path, _, _ in walk(FRAME, Parameter)]
    assert [rule.name for rule in rules(FRAME)] == paths

    @jax.jit
    def valid(low, least):
        return all_hold(rules((Material(low=low, high=5.0, least=least),)))

    flags = [bool(valid(*ends)) for ends in ((1.0, 1.0), (1.0, 0.5), (2.0, 1.0))]
    assert flags == [True, False, False]
    flags = jax.vmap(valid, (None, 0))(1.0, jnp.array([0.5, 1.0, jnp.nan, jnp.inf]))
    np.testing.assert_array_equal(flags, [False, True, False, False])


def test_plain_dataclasses_and_parameters_like_another_are_checked_too():
    assert Plain(2).size == 2.0
    assert Plain(2.0, Material()).inner.size == 1.0
    refused(r"Plain: size of shape \(2,\) must be one number", Plain, [1.0, 2.0])
    refused("Plain: size = -1 must be positive and finite", Plain, -1)
    refused(r"Plain: inner = 3 must be of type Material or None", Plain, 1.0, 3)
    refused(r"Copy: least = 1 must .* at least low = 2 \(by law\)", Copy, 2.0, 1.0)


@pytest.mark.parametrize("kind", [Wall, Other])
def test_a_part_may_be_missing_of_any_kind_that_can_do_it_and_must_be_a_pytree(kind):
    assert kind().held is None
    assert [rule.name for rule in rules(kind(Peg(1.0)))] == ["held.size"]
    name = kind.__name__
    refused(f"{name}: held = 3 must be of type Holder or Peg or None", kind, 3)
    refused(f"{name}: held = <class .*Hook'> must be of type Holder", kind, Hook)
    refused(f"{name}: held of type Hook must be a pytree: put @", kind, Hook())


def test_a_class_tells_what_its_objects_would_but_not_what_may_be_missing():
    assert list(walk(Wall, Parameter)) == []
    found = {path: known for path, known, value in walk(Frame, Parameter) if value is None}
    assert {"one.size", "more.*.size", "weights.*"} <= found.keys()
    assert found["more.*.size"] == {p: k for p, k, _ in walk(FRAME, Parameter)}["one.size"]
    known = {path: known for path, known, _ in walk(Material, Parameter)}
    assert {path for path in known if known[path].is_ratio} == {"size", "low", "high", "least"}

    @dataclasses.dataclass(frozen=True)
    class Result:
        length: float = quantity("length", "a length")

    length = "length", Quantity("length", "a length", ""), 2.0
    assert list(walk(Result(2.0), Quantity)) == [length]
    assert not list(walk(Result(2.0), Parameter))


def test_long_objects_are_shown_in_short_and_numbers_of_numpy_as_pythons():
    material = Material(order=1 / 3)
    assert repr(material) == (
        "Material(order=0.3333333333333333, share=0.5, free=-3.0, size=1.0, gap=inf, low=1.0, "
        "high=2.0, least=1.0)"
    )
    few = Frame(material, (material,), (0.5, 1.0))
    assert repr(few) == f"Frame(one={material!r}, more=({material!r},), weights=(0.5, 1.0))"
    many = Frame(material, (material,) * 30, (1 / 3, *range(40)))
    shown = repr(many)
    assert len(shown) < 500
    assert "weights=(0.333333, <39 more>, 39)" in shown
    assert shown.count("order=0.333333, share") == 3
    assert "<28 more>" in shown
    assert "..." in repr(jax.tree.map(lambda x: np.full(500, x), many))
    jax.jit(lambda tree: repr(tree) and 0)(many)
    building = jp.Building(np.float64(5e5), np.float32(2.5), np.int64(1), 0.25, np.float64(0.5))
    numbers = "mass=500000.0, stiffness=2.5, order=1.0, tau_f=0.25, tau_x=0.5"
    assert repr(building) == f"Building({numbers})"
    assert repr(jp.LogNormal(np.float64(2), 0.5)) == "LogNormal(median=2.0, sigma=0.5)"
    assert "float64" not in repr(jp.Storeys((np.float64(1.0),), jp.Rod(jp.ZenerRod(1, 1, 1), 1.0)))
