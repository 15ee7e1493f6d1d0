"""Designs whose search has its options beside those of the call."""

import dataclasses

import jaxpound as jp

OPTIONS = {field.name for field in dataclasses.fields(jp.DesignSearch)}


def in_search(options):
    """Options of ``design_damper``, with those of a ``DesignSearch`` in one."""
    search = jp.DesignSearch(**{x: options[x] for x in OPTIONS & options.keys()})
    return {"search": search} | {x: y for x, y in options.items() if x not in OPTIONS}
