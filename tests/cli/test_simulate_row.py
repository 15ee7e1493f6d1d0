"""``jaxpound simulate`` of buildings in a row: its numbers are the API's, its files are whole."""

import re

import numpy as np
import pytest
from matplotlib.image import imread

import jaxpound as jp
from jaxpound.cli import files, simulate
from jaxpound.cli.simulate import result_lines
from jaxpound.model.places import rod_places
from tests.cli.commands import changed, simulated
from tests.cli.written import csv_rows, summary


def short() -> str:
    """The example for a short run, with one law of contact: each takes long to compile.

    And the second building is as high as the others.
    """
    changes = "duration = 1.6 & scale = 2.5 & floors = -> floor = 2"
    changes += " & masses = [250e3, 200e3] & stiffnesses = [150e6, 100e6]"
    head, tail = changed(files.example("simulate", "row"), changes).rsplit("\ncontact = ", 1)
    return head + "\n" + tail.split("\n", 1)[1]


@pytest.fixture(scope="module")
def of_example(pulse, tmp_path_factory):
    """The row of the example under the pulse: screen, folder, layout, and the same by the API."""
    return simulated(short(), pulse, tmp_path_factory.mktemp("row"))


def test_the_summary_has_the_api_s_numbers_and_impacts_by_link(of_example):
    screen, out, layout, response = of_example
    answers = summary(out)
    told, demand = answers["results"], response.demand
    assert answers["run"]["steps"] == response.time.size - 1
    assert told["min_gap_m"] == pytest.approx(float(demand.min_gap), rel=1e-12)
    by_links = sum(one["damper_energy_J"] for one in told["links"])
    assert told["damper_energy_J"] == pytest.approx(by_links, rel=1e-3)  # by two quadratures
    for one, building in zip(told["buildings"], layout.shear_buildings, strict=True):
        modes = building.modes()
        assert [x["period_s"] for x in one["modes"]] == pytest.approx(modes.periods)
        assert [x["damping_ratio"] for x in one["modes"]] == pytest.approx(modes.damping_ratios)
        peaks = [float(demand.masses[n - 1].peak_x) for n in one["series"]]
        assert one["peak_displacement_m"] == max(peaks)
        assert one["base_shear_N"] == float(demand.rods[one["series"][0] - 1].peak_force)
    assert [one["series"] for one in told["buildings"]] == [[1, 2], [3, 4], [5, 6]]
    for one, link, scalars in zip(told["links"], layout.buildings.links, demand.links, strict=True):
        assert one["floor"] == link.floor + 1
        assert one["slip_distance_m"] == (float(scalars.slip_distance) if link.friction else None)
        assert (one["contact"] is None) == (link.contact is None)
    brace = told["links"][2]
    assert (brace["building"], brace["floor"]) == (2, 1)
    assert (brace["next_building"], brace["next_floor"]) == ("ground", None)
    assert brace["gap_m"] is brace["min_gap_m"] is brace["first_contact_s"] is None
    touched = [one["first_contact_s"] for one in told["links"]]
    assert told["first_contact_s"] == min(time for time in touched if time is not None)
    contact, impacts = told["links"][0]["contact"], response.impacts(0)
    assert contact["n_impacts"] == len(contact["impacts"]) == len(impacts) > 0
    assert contact["peak_contact_N"] == float(response.demand.links[0].peak_contact)
    assert touched[0] == impacts[0].time
    # The second link has a gap but no law: its floors overlap, and by more.
    assert response.links[1].gap[np.searchsorted(response.time, touched[1])] <= 0
    assert f"overlap {told['overlap_m']:.4g} m, first contact at " in screen
    assert f"contact 1–2, floor 2      {contact['n_impacts']:.0f} impacts, p" in screen


def test_series_have_all_floors_and_the_envelope_their_peaks(of_example):
    _, out, layout, response = of_example
    series = np.load(out / "series.npz")
    floors = csv_rows(out / "floors.csv")
    places = [(b, i) for b, x in enumerate(layout.shear_buildings) for i in range(x.n_floors)]
    assert [(int(x["building"]) - 1, int(x["floor"]) - 1) for x in floors] == places
    demands = jp.floor_demands(layout.buildings, response.demand)
    assert "drift ratio (%)" in str(demands[0])
    for b, table in enumerate(demands):
        table.to_csv(out / "table.csv")
        expected = [row for row, (i, _) in zip(floors, places, strict=True) if i == b]
        for of_api, row in zip(csv_rows(out / "table.csv"), expected, strict=True):
            assert {x: float(y) for x, y in of_api.items()} == {x: float(y) for x, y in row.items()}
    for row, (b, i) in zip(floors, places, strict=True):
        assert float(row["elevation_m"]) == layout.shear_buildings[b].elevations[i]
        x = series[f"x{row['series']}_m"]
        assert 0 <= float(row["displacement_m"]) / np.abs(x).max() - 1 < 1e-2
        below = series[f"x{int(row['series']) - 1}_m"] if i else 0
        drift = float(row["drift_m"])
        assert 0 <= drift / np.abs(x - below).max() - 1 < 1e-2  # the grid may miss the top
        assert float(row["drift_ratio"]) == pytest.approx(drift / 3.0)
        assert float(row["drift_ratio"]) == float(demands[b].drift_ratio[i])
        for name, column in (("shear", "shear_N"), ("contact_right", "contact_right_N")):
            assert float(row[column]) == float(getattr(demands[b], name)[i])


def test_figures_have_the_units_and_numbers_of_the_table(of_example):
    """Loops are in panels of their own, drift is in %, accelerations are in m/s²."""
    screen, _, layout, response = of_example
    figures = simulate._figures(layout, response)
    assert [ax.get_title() for ax in figures["rod_hysteresis"].axes] == [
        place for place in rod_places(response.topology) if "storey" in place
    ]
    labels = [ax.get_xlabel() for ax in figures["envelopes"].axes]
    assert any("(%)" in words for words in labels)
    assert any("(m/s²)" in words for words in labels)
    line = figures["ground_motion"].axes[0].lines[0]
    assert f"({np.abs(line.get_ydata()).max():.4g} m/s²)" in screen
    assert screen.count("floor by floor") == 3


def test_every_figure_is_drawn_and_what_a_row_lacks_is_not_told(of_example):
    screen, out, *_ = of_example
    figures = {path.stem for path in out.glob("*.png")}
    assert figures == {
        *("overview", "row", "envelopes", "gap_map", "ground_motion", "displacements", "gap"),
        *("friction_force", "friction_hysteresis", "rod_hysteresis", "energy"),
        *("contact_force", "contact_hysteresis"),
        *(f"mode_shapes_{i}" for i in (1, 2, 3)),
    }
    for path in out.glob("*.png"):
        assert min(imread(path).shape[:2]) > 400
        assert str(path) in screen
    # What has no damper, gap or law is told without them.
    results = summary(of_example[1])["results"]
    for link in results["links"]:
        link |= {"contact": None, "friction_force_N": 0.0}
    told = "\n".join(result_lines(results))
    assert not re.search(r"damper|contact \S+ J|collapsed|bearings", told)
    assert "overlap" in told
