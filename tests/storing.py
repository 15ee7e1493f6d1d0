"""A study by options of ``monte_carlo`` and of its ``Storage`` together."""

import dataclasses

import jaxpound as jp

KEPT = [field.name for field in dataclasses.fields(jp.Storage)]


def studied(scenarios, n, grid, store=None, **options):
    kept = {name: options.pop(name) for name in KEPT if name in options}
    storage = jp.Storage(store, **kept)
    return jp.monte_carlo(scenarios, n, grid, store=storage, progress=False, **options)
