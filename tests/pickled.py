"""What comes back from a pickle."""

import pickle
from collections.abc import Mapping
from functools import partial

import numpy as np


def assert_survives_pickling(thing):
    """It comes back from bytes, of its type and with its numbers, and so again from there."""
    again = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(thing))))
    assert_same(thing, again)
    assert repr(again) == repr(thing)
    return again


def assert_same(one, other, path="it"):
    assert type(one) is type(other), path
    if isinstance(one, Mapping):
        assert [*one] == [*other], path
        parts = [(f"[{key!r}]", one[key], other[key]) for key in one]
    elif isinstance(one, tuple | list):
        assert len(one) == len(other), path
        parts = [(f"[{i}]", *pair) for i, pair in enumerate(zip(one, other, strict=True))]
    elif isinstance(one, partial):
        parts = [(name, getattr(one, name), getattr(other, name)) for name in ("func", "args")]
    elif not type(one).__module__.startswith("jaxpound"):
        np.testing.assert_array_equal(one, other, path)
        parts = []
    elif type(one).__reduce__ is not object.__reduce__:  # what it is made of, without the rest
        parts = [("", one.__reduce__()[1], other.__reduce__()[1])]
    else:
        parts = [("", one.__getstate__(), other.__getstate__())]
    for name, *pair in parts:
        assert_same(*pair, path + name)
