"""``jaxpound montecarlo``, ``report`` and ``design`` of buildings in a row."""

import re

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.cli import design, files, montecarlo, report
from jaxpound.cli.reading import File
from jaxpound.model.places import link_places
from jaxpound.plots import studies as plots
from tests.cli.commands import changed, layout_of, refusal, run
from tests.cli.written import summary, tables

STUDY, DESIGN = (files.example(command, "row") for command in ("montecarlo", "design"))
SHORT = """duration = 3.0 ; dt = 0.01 & wavelets = 2 & arrivals = {uniform = [0.5, 2.5]}
    & amplitude = {uniform = [0.01, 0.03]}"""


def test_the_example_s_random_storeys():
    file = File("row.toml", STUDY)
    given = file.read(montecarlo.StudyConfig)
    structures, layout = montecarlo.prepared(file, given)[0].structures, given.layout
    names = [*structures.uncertain]
    storeys = [f"buildings.{b}.storeys.{i}" for b, n in ((0, 2), (1, 3)) for i in range(n)]
    stiffness = [f"{storey}.stiffness" for storey in storeys]
    assert names[:5] == stiffness
    assert names[-1] == "links.2.friction"  # the third link is that of the second table
    alike = structures.correlations[0]
    assert alike.tolist() == [1.0, 0.5] + [0.0] * (len(names) - 2)
    drawn = structures.parameters(np.zeros(len(names)))
    for path in stiffness:
        b, i = (int(part) for part in re.findall(r"\d+", path))
        stated = layout.shear_buildings[b].storeys[i].stiffness
        assert float(drawn[path]) == pytest.approx(float(stated))


def test_what_a_range_cuts_off_is_said_by_the_key_of_the_file(tmp_path, capsys):
    path, orders = tmp_path / "row.toml", '"building.2.storey.*.order"'
    path.write_text(changed(STUDY, f'"building.*.floor -> {orders} = {{uniform = [0.8, 8.0]}}'))
    file = File("row.toml", path.read_text())
    with pytest.warns(jp.PlausibilityWarning) as warned:
        montecarlo.prepared(file, file.read(montecarlo.StudyConfig))
    assert len(warned) == 3
    for i, warning in enumerate(warned, start=1):
        says = rf"\[uncertain\] building.2.storey.{i}.order ~ Uniform\(low=.*cut off"
        assert re.search(says, str(warning.message))
    line = refusal(capsys, "montecarlo", path, "--store", tmp_path / "store", "--strict")
    assert "row.toml: [uncertain] building.2.storey.1.order ~" in line


def test_a_study_of_a_row_and_its_report(tmp_path):
    path, store, out = (tmp_path / name for name in ("row.toml", "store", "out"))
    masses = '"building.*.floor.*.mass" = {lognormal = [1.0, 0.05]}'  # soon compiled
    text = changed(STUDY, f"{SHORT} & samples = 40 & spectral_acceleration = true & {masses}")
    path.write_text(text.replace("number = 3", "number = 2"))
    screen = run("montecarlo", path, "--store", store)
    assert "probability of pounding" in screen
    of_damper = ["slip_distance_3", "friction_work_3"]  # links 1 and 2 have none
    assert re.findall(r"slip_distance_\d|friction_work_\d", screen) == of_damper
    run("report", "--store", store, "--out", out)
    study, answers = jp.Study.open(store), summary(out)
    assert [one["link"] for one in answers["links"]] == [1, 2]  # the brace has no gap
    for k, one in enumerate(answers["links"]):
        assert one["pounding_probability"]["value"] == study.pounding_probability(link=k).value
        for p, gap in one["required_gap"].items():
            assert gap["value"] == study.required_gap(float(p), link=k).value
    assert 0 < answers["links"][1]["pounding_probability"]["value"] < 1
    page, places = (out / "summary.md").read_text(), link_places(study.topology)
    assert "# Monte Carlo study of buildings" in page
    assert re.findall(r"slid by the damper, ([^|]*) \|", page) == [places[2]]
    (links,) = (table for table in tables(page) if "between" in table[0])
    assert links[1]["between"] == "1–2, floor 2"
    value = answers["links"][1]["pounding_probability"]["value"]
    assert links[1]["probability of pounding"].startswith(f"{value:.4g} (95%")
    assert "absolute sum" not in page
    assert "peak displacement of floor 2 of building 2" in page
    fitted = [one["fragility_by_pga"] for one in answers["links"]]
    assert any(fitted)
    assert ("No fragility curve fits a link" in page) == (None in fitted)
    drawn = report.fragilities_of_links(study)
    assert drawn.keys() - {"any link"} == {places[k] for k in (0, 1) if fitted[k]}
    assert drawn["any link"].median == answers["fragility"]["pga"]["median"]
    assert answers["fragility"]["spectral_acceleration_1"]["unit"] == "m/s²"
    assert "![fragility of links](fragility_of_links.png)" in page
    shown = plots.fragility(drawn["any link"])
    assert shown.get_xlabel() == str(study.measure("pga")) == "peak ground acceleration (m/s²)"
    assert f"= {answers['fragility']['pga']['median']:.3g} m/s²" in shown.lines[0].get_label()
    for figure in ("min_gap", "required_gap", "fragility_of_links", "correlations", "parameters"):
        assert (out / f"{figure}.png").exists()


BRACES = """building = [{storeys = {number = 2, mass = 2e5, period = 0.5, damping_ratio = 0.05}}]
link = [{building = 1, floors = [1, 2], next_building = 1, friction_force = 50e3}]
"""


def test_braces_alone_have_a_response_to_be_least():
    text = changed(DESIGN, f"{SHORT} & total_damper_force = 4e5")
    head, tail = text[: text.index("[[building]]")], text[text.index("# Random earthquakes") :]
    file = File("row.toml", head + BRACES + tail)
    goal = r"SmallestGap\(over='mean'\)"
    says = rf"objective: goal = {goal} must not be of gaps where no link has a finite one"
    with pytest.raises(ValueError, match=says):
        design.prepared(file, file.read(design.DesignConfig))
    least = changed(file.text, 'goal = "least demand" & demand = "peak_drift"')
    file = File("row.toml", least)
    posed, _ = design.prepared(file, file.read(design.DesignConfig))
    assert posed.objective.goal == jp.design.LeastDemand("peak_drift")
    assert posed.space.names == ("links.0.friction", "links.1.friction")


@pytest.mark.usefixtures("without_pictures", "without_elasticities")
def test_dampers_of_a_row_share_a_budget(tmp_path):
    path, out = tmp_path / "row.toml", tmp_path / "out"
    few = "earthquakes = 4 & fresh = 4 & starts = 1 & iterations = 3 & peak_drift = 0.5"
    few += ' & dt = 0.01 ; friction = "switching"'  # soon compiled
    text = changed(DESIGN, f"{SHORT} & {few}").replace("number = 3", "number = 2")
    head, tail = text.split("[[link]]\nbuilding = 2", 1)
    path.write_text(head + tail[tail.index("# Random earthquakes") :])
    screen = run("design", path, "--out", out, "--save", tmp_path / "search.npz")
    assert (tmp_path / "search.npz").exists()
    answers = summary(out)
    assert answers["limits"]["total_damper_force"]["reached"] <= 400e3 * 1.001
    *chosen, together = answers["answer"]
    assert [row["quantity"] for row in chosen] == [f"slip force, 1–2, floor {i}" for i in (1, 2)]
    assert together["after"] == pytest.approx(sum(row["after"] for row in chosen))
    assert "forces of all dampers together" in screen
    layout = layout_of((out / "buildings.toml").read_text())
    forces = [float(link.friction) for link in layout.buildings.links]
    assert all(force == 0 or force > 1e3 for force in forces)  # no rounding next to a bound
    assert forces == pytest.approx([row["after"] for row in chosen])
    stated = File("row.toml", path.read_text()).read(design.DesignConfig).layout
    for building, original in zip(layout.shear_buildings, stated.shear_buildings, strict=True):
        assert building.modes().periods == pytest.approx(original.modes().periods)
        assert building.elevations.tolist() == original.elevations.tolist()
    page = (out / "summary.md").read_text()
    assert "# Design of buildings" in page
    assert "forces of all dampers together" in page
