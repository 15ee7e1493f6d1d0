"""The files of ``examples/catalogue.py`` as OpenQuake and pelicun read them.

    python -m venv other && other/bin/pip install openquake.engine pelicun fiona pyproj shapely
    python examples/catalogue.py --out catalogue
    other/bin/python benchmarks/read_catalogue.py catalogue

Every curve must have the probabilities of its lognormal capacity in OpenQuake, and its median and
dispersion in pelicun. It needs nothing of jaxpound.
"""

import sys
from pathlib import Path

import numpy as np
import openquake.risklib.read_nrml  # noqa: F401 (it registers fragility models)
import pandas as pd
from openquake.hazardlib import nrml
from openquake.risklib.scientific import FragilityFunctionContinuous
from pelicun.assessment import Assessment
from scipy.stats import lognorm

SHARES = 0.5, 1.1, 2.0  # of the median
GRAVITY = 9.80665  # m/s², in which pelicun has accelerations


def read_by_openquake(folder, table):
    """The number of curves that OpenQuake reads with the probabilities of the table."""
    functions = nrml.to_python(str(folder / "pounding.xml"))
    for key, function in functions.items():
        name = key[-1] if isinstance(key, tuple) else key
        median, dispersion = table.loc[name, ["LS1-Theta_0", "LS1-Theta_1"]]
        ends = float(function.minIML), float(function.maxIML)
        curve = FragilityFunctionContinuous("pounding", *function.array[0], *ends)
        levels = np.array(SHARES) * median
        levels = levels[(levels > ends[0]) & (levels < ends[1])]
        known = lognorm.cdf(levels, dispersion, scale=median)
        np.testing.assert_allclose(curve(levels), known, rtol=1e-6, atol=1e-9, err_msg=name)
    return len(functions)


def read_by_pelicun(folder, table):
    """The number of curves that pelicun reads with the numbers of the table."""
    assessment = Assessment({"PrintLog": False, "Seed": 1})
    file = str(folder / "fragility.csv")
    assessment.damage.load_model_parameters([file], set(table.index))
    models = (model.damage_params for model in assessment.damage._damage_models)
    read = pd.concat([numbers for numbers in models if numbers is not None])
    for name, unit in (("Theta_0", GRAVITY), ("Theta_1", 1.0)):
        numbers = read[("LS1", name)].astype(float) / unit
        known = table.loc[read.index, f"LS1-{name}"]
        np.testing.assert_allclose(numbers, known, rtol=1e-9)
    return len(read)


def main(folder):
    table = pd.read_csv(folder / "fragility.csv").set_index("ID")
    for program, read in {"OpenQuake": read_by_openquake, "pelicun": read_by_pelicun}.items():
        print(f"{program} reads {read(folder, table)} of {len(table)} curves as they are")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
