"""The documentation's own rules, without building it: nothing public and no page is left out."""

import doctest
import importlib.util
import pkgutil
import re
import tomllib
from dataclasses import fields, is_dataclass, replace
from itertools import chain
from pathlib import Path

import jax
import pytest
from PIL import Image

import jaxpound as jp
from jaxpound._fields import _SPEC, Parameter
from jaxpound.cli import main as cli

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PACKAGE = Path(jp.__file__).parent
MADE = ("_build", "generated", "jupyter_execute", "notebooks")  # by a build
PAGES = sorted(
    page for page in DOCS.rglob("*.md") if not set(MADE) & set(page.relative_to(DOCS).parts[:-1])
)


def entries(directive, page):
    """The lines in the bodies of a page's directives of one kind, their options left out."""
    body, inside = [], False
    for line in page.read_text(encoding="utf-8").splitlines():
        if re.match(rf"(```\{{{directive}\}}|\.\. {directive}::)", line):
            inside = True
        elif inside and (line.startswith(("```", "..", "#")) or (line and line[0] == "`")):
            inside = False
        elif inside and line.strip() and not line.strip().startswith(":"):
            body.append(line.strip())
    return body


def reference():
    listed = [name for page in PAGES for name in entries("autosummary", page)]
    assert len(listed) == len(set(listed)), "each name once"
    return listed


def test_the_reference_and_the_tables_of_contents_leave_nothing_out():
    # A constant is listed by the module that documents it.
    assert set(jp.__all__) <= {name.rpartition(".")[2] for name in reference()}
    for name in reference():
        pkgutil.resolve_name(name if name.startswith("jaxpound") else f"jaxpound.{name}")
    modules = {path.stem for path in (PACKAGE / "plots").glob("[a-z]*.py")}
    modules -= {"contact_paths", "curves", "style", "panels", "sliders"}  # what figures are made of
    assert {f"jaxpound.plots.{module}" for module in modules} <= set(reference())
    contents = [page.parent / entry for page in PAGES for entry in entries("toctree", page)]
    assert {*PAGES} - {page.with_suffix(".md") for page in contents} <= {DOCS / "index.md"}


def code(text):
    return "".join(re.findall(r"^```python\n(.*?)^```", text, re.M | re.S))


EXTENDING = (DOCS / "extending.md").read_text(encoding="utf-8")
FIRST, *SECTIONS = re.split(r"^## ", EXTENDING, flags=re.M)


@pytest.mark.parametrize("section", SECTIONS, ids=lambda section: section.partition("\n")[0])
def test_every_extension_runs(section):
    """Each section asserts what its extension must do."""
    assert "assert" in code(section)
    exec(code(FIRST) + code(section), {"__name__": "extending"})


BESIDE = sorted(page for page in (DOCS / "beside").glob("*.md") if page.stem != "index")


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
@pytest.mark.parametrize("page", BESIDE, ids=lambda page: page.stem)
def test_every_page_on_another_library_runs(page):
    """Each asserts what it must give."""
    library = "SALib" if page.stem == "salib" else page.stem
    pytest.importorskip(library)
    text = code(page.read_text(encoding="utf-8"))
    assert library in text
    assert "assert" in text
    exec(text, {"__name__": page.stem})


def test_no_page_installs_from_an_index():
    """The package is installed from its clone, as the README says."""
    paths = [ROOT / "README.md", *PAGES, *(ROOT / "notebooks").glob("*.ipynb")]
    texts = "\n".join(path.read_text(encoding="utf-8") for path in paths)
    commands = re.findall(r"pip install ([^`\n]+)", texts)
    assert len(commands) > 4
    assert not [command for command in commands if "jaxpound" in command.partition("&&")[0]]


def test_every_file_that_a_page_names_exists():
    for page in (ROOT / "CONTRIBUTING.md", ROOT / "benchmarks" / "README.md", *PAGES):
        text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
        for name in re.findall(r"`(\w+/[\w/]+\.py)`", text):
            folders = ROOT, PACKAGE, PACKAGE / "simulation"
            assert any((folder / name).is_file() for folder in folders), f"{page.name}: {name}"
    parts = (ROOT / "benchmarks" / "where_time_goes.py").read_text(encoding="utf-8")
    (parts,) = re.findall(r"^PARTS = \{$(.*?)^\}$", parts, re.M | re.S)
    names = re.findall(r"\w+\.py", parts)
    assert {*names} <= {path.name for path in PACKAGE.rglob("*.py")}


def test_every_extra_and_every_command_has_its_section(capsys):
    with pytest.raises(SystemExit):
        cli.main(["--help"])
    listed = capsys.readouterr().out.partition("COMMAND\n")[2]
    commands = re.findall(r"^    (\w+)", listed, re.M)
    page = (DOCS / "command_line.md").read_text(encoding="utf-8")
    assert commands
    assert re.findall(r"^```\{command-help\} (\w+)$", page, re.M) == commands
    with (ROOT / "pyproject.toml").open("rb") as file:
        extras = tomllib.load(file)["project"]["optional-dependencies"]
    page = (DOCS / "installation.md").read_text(encoding="utf-8").partition("## Extras")[2]
    assert {*re.findall(r"^\| `(\w+)` \|", page, re.M)} == {*extras}


def test_every_comparison_of_the_readme_was_measured():
    """Its numbers are in the page that the row's command makes, or is the heading of."""
    page = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")
    _, *sections = re.split(r"^## ", page, flags=re.M)
    row = r"^\|.*\| JAX [^|]* \|(.*)\| `(python (?:-m )?benchmarks[^ `]*)[^`]*` \|$"
    rows = re.findall(row, (ROOT / "README.md").read_text(encoding="utf-8"), re.M)
    assert len(rows) == 6
    for numbers, command in rows:
        if command.endswith(".verification"):
            section = (DOCS / "verification.md").read_text(encoding="utf-8")
        else:
            (section,) = (text for text in sections if text.startswith(f"`{command}"))
        measured = re.findall(r"\d[\d.,]*\d|\d", section)
        for number in re.findall(r"\d[\d.,]*\d|\d", numbers):
            assert number in measured, f"{command}: {number}"


def test_the_examples_of_the_questions_are_right():
    page = DOCS / "faq.md"
    names = {"jp": jp, "jax": jax, "replace": replace}
    text = re.sub(r"^```.*", "", page.read_text(encoding="utf-8"), flags=re.M)
    examples = doctest.DocTestParser().get_doctest(text, names, page.name, str(page), 0)
    assert len(examples.examples) > 4
    runner = doctest.DocTestRunner()
    runner.run(examples)
    assert not runner.failures


def of_docs(name):
    """A module beside the pages."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def from_notebooks():
    """The extension that takes pictures from the notebooks."""
    pytest.importorskip("sphinx")
    return of_docs("from_notebooks")


def test_pictures_and_notebooks_are_listed(from_notebooks):
    for directive, page in (("gallery", "gallery.md"), ("notebook-list", "notebooks.md")):
        lines = entries(directive, DOCS / page)
        assert lines
        for source, code, *_ in (line.split(" | ") for line in lines):
            stem, _, number = source.partition(" ")
            if stem == from_notebooks.SCRIPT:
                assert (DOCS / code).exists()
            else:
                assert from_notebooks.picture(stem, code, int(number or 1)).heading
    listed = [line.partition(" | ")[0] for line in entries("notebook-list", DOCS / "notebooks.md")]
    assert listed == sorted(path.stem for path in (ROOT / "notebooks").glob("*.ipynb"))


def test_the_risk_of_an_impact_is_that_of_its_notebook(from_notebooks):
    """Every decimal number of the page's section is in the code there, or was printed."""
    page = (DOCS / "isolation.md").read_text(encoding="utf-8")
    section = page.partition("## One in a thousand")[2].partition("\n## ")[0]
    notebook = from_notebooks.read(ROOT / "notebooks" / "11_isolated_and_its_wall.ipynb")
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    texts = [text for c in cells for text in (c.source, *(x.get("text", "") for x in c.outputs))]
    numbers = re.findall(r"[-+]?\d+\.\d+", section)
    assert len(numbers) > 20
    for number in numbers:
        assert any(re.search(rf"(?<![\d.]){re.escape(number)}", text) for text in texts), number


def test_below_a_public_name_are_the_pages_that_use_it():
    uses = of_docs("uses")
    assert "how_to/soil" in uses.users("jaxpound.on_soil")
    assert "api/ground" in uses.users("jaxpound.ground.PeriodRange")
    assert uses.users("jaxpound.TimeGrid")[0] in uses.uses()["TimeGrid.until"]
    lines = ["A grid."]
    uses.list_users(None, "class", "jaxpound.TimeGrid", jp.TimeGrid, None, lines)
    assert lines[2] == ".. rubric:: Examples that use this"
    pages = re.findall(r":doc:`/([^`]+)`", lines[4])
    assert 1 < len(pages) <= uses.MOST
    for page in pages:
        file = ROOT / f"{page}.ipynb" if "notebooks" in page else DOCS / f"{page}.md"
        assert "jp.TimeGrid" in file.read_text(encoding="utf-8")


def test_the_picture_of_choices_is_that_of_its_page():
    """Each choice has three lines: for what, not for what, and where to read on."""
    pictures = of_docs("pictures")
    questions = pictures.choices()
    assert len(questions) == 6
    with Image.open(DOCS / "which_one.png") as picture:
        assert picture.text["Description"] == str(questions), "python docs/pictures.py which_one"
    text = (DOCS / "which_one.md").read_text(encoding="utf-8")
    leaves = re.findall(r"^- .*\n  For .*\n  Not .*\n  See .*\)\.$", text, re.M)
    assert len(leaves) == len(re.findall(r"^- ", text, re.M)) == sum(map(len, questions.values()))


PURE = {  # numbers without a unit
    *("AdjacentStructures.mass_ratio", "AdjacentStructures.stiffness_ratio"),
    *("Bilinear.hardening", "BoucWen.beta", "BoucWen.exponent", "BoucWen.hardening"),
    *("BoucWen.stiffness_degradation", "BoucWen.strength_degradation", "Building.order"),
    *("CloughPenzien.damping", "CloughPenzien.high_pass_damping", "Column.position"),
    *("FilteredNoise.samples", "FrictionPendulum.fast_friction", "FrictionPendulum.friction"),
    *("GammaEnvelope.power", "HertzDamped.restitution", "Jankowski.restitution"),
    *("KanaiTajimi.damping", "KelvinVoigt.restitution", "LeadRubber.strength", "Link.weights"),
    *("LogNormal.sigma", "ModalDamping.ratios", "Newton.restitution", "NonstationaryNoise.damping"),
    *("NonstationaryNoise.samples", "PowerLaw.exponent", "Pulse.cycles", "RandomRicker.negative"),
    *("RandomRicker.wavelets", "Rayleigh.ratio", "Rod.weights", "Scaled.factor"),
    *("SiteBasedNoise.magnitude", "SiteBasedNoise.samples", "Soil.poisson_ratio"),
    "Storage.chunk_size",
    *("TargetSpectrum.damping", "TimeGrid.n_steps", "TwoSided.negative", "ZenerRod.order"),
} | {"LogNormal.median", "Normal.mean", "Normal.std", "Uniform.low", "Uniform.high"}  # any unit


METHODS = {"reliability", "design", "study", "hazard"}  # of which the table has the chief classes


def test_the_table_of_inputs_leaves_nothing_out():
    """All public classes with parameters, and each cell, unless an object has none."""
    pytest.importorskip("sphinx")
    table = of_docs("table_of_inputs")
    subjects = table.subjects(entries("inputs", DOCS / "inputs.md"))
    names = [*chain(*subjects.values())]
    classes = [pkgutil.resolve_name(f"jaxpound.{name}") for name in names]
    assert len(classes) == len(set(classes))
    spaces = jp, jp.model, jp.ground, jp.scenarios
    public = {getattr(space, name) for space in spaces for name in space.__all__}
    described = {x for x in public if isinstance(x, type) and is_dataclass(x) and parameters_of(x)}
    assert {x for x in described if x.__module__.split(".")[1] not in METHODS} <= set(classes)

    rows = {}
    for name, cls in zip(names, classes, strict=True):
        numbers = set(parameters_of(cls))
        for row in table.rows(name):
            field = re.match(r"`([^`]*)`", row.name)[1]
            path = f"{cls.__name__}.{field}"
            rows[path] = row
            assert "" not in row, path
            if field in numbers or "(" in field:
                assert table.NONE not in (row.default, row.must, row.usual, row.source), path
            if field in numbers:
                assert (row.unit == table.NONE) == (path in PURE), path
    assert set(rows) >= PURE
    owners = {path.partition(".")[0] for path in rows}
    for words in (table.USUAL, table.UNITS, table.SOURCES):
        assert set(words) <= set(rows) | owners
    by_name = {path.partition(".")[2] for path in rows}
    assert set(table.MUST) <= set(rows) | owners | by_name


def parameters_of(cls):
    """The names of the fields that are parameters."""
    return [x.name for x in fields(cls) if isinstance(x.metadata.get(_SPEC), Parameter)]


def test_every_source_of_an_input_is_in_the_bibliography_or_a_page():
    pytest.importorskip("sphinx")
    for source in of_docs("table_of_inputs").SOURCES.values():
        if page := re.search(r"\]\(([\w/]+\.md)", source):
            assert (DOCS / page[1]).exists(), source
        else:
            author, _, year = source.partition(" (")
            names = re.split(r", | and ", author)
            assert any(
                source in entry
                or (f"({year}" in entry and all(x in entry.split(":")[0] for x in names))
                for entry in BIBLIOGRAPHY
            ), source


PAGE = (DOCS / "bibliography.md").read_text(encoding="utf-8")
BIBLIOGRAPHY = [" ".join(entry.split()) for entry in re.split(r"^- ", PAGE, flags=re.M)[1:]]


def test_the_glossary_and_the_bibliography_are_in_order():
    body = (DOCS / "glossary.md").read_text(encoding="utf-8").partition("{glossary}")[2]
    terms = re.findall(r"^(\S.*)$", body.partition("\n```")[0], re.M)
    assert len(terms) > 30
    assert terms == sorted(set(terms), key=str.lower)
    title = "Dynamics of adjacent structures during horizontal ground motion"
    earlier_title = (
        "Earthquake response of adjacent structures with viscoelastic and friction dampers"
    )
    files = ROOT / "README.md", ROOT / "CITATION.cff", PACKAGE / "paper.py", DOCS / "model.md"
    for file in (*files, DOCS / "bibliography.md"):
        text = " ".join(file.read_text(encoding="utf-8").split())
        assert title in text, file.name
        assert "Grahovac" in text, file.name
        assert earlier_title not in text.partition(title)[0], file.name
    first, earlier, *others = BIBLIOGRAPHY
    for entry, its_title in ((first, title), (earlier, earlier_title)):
        assert entry.startswith("Žigić")
        assert f"*{its_title}*" in entry
    assert "earlier paper" in earlier
    form = r"[^:*]+ \((18|19|20)\d\d\): \*[^*]+\*( \(in Russian\)|, \w+ edition)?\. "
    for entry in others:
        assert re.match(form, entry)
    links = re.findall(r"\[(doi|arXiv):([^]]+)\]\(https://([^)]+)\)", " ".join(others))
    assert links
    for kind, number, address in links:
        assert address == {"doi": "doi.org/", "arXiv": "arxiv.org/abs/"}[kind] + number


def test_every_source_that_is_named_is_in_the_bibliography():
    name = r"(?:Den |Der )?[A-Z][\w’'-]+"
    names, year = rf"({name}(?:, {name})*(?: and {name})?)", r"((?:18|19|20)\d\d)"
    named = re.compile(rf"{names}(?: et al\.)? \(?{year}[);,]")
    modules = sorted(PACKAGE.rglob("*.py"))
    pages = [page for page in PAGES if page.stem not in ("bibliography", "changelog")]
    found = [
        (path.name, *source)
        for path in (*modules, *pages)
        for source in named.findall(" ".join(path.read_text(encoding="utf-8").split()))
    ]
    assert {"Clopper and Pearson", "Jeng, Kasai and Maison"} <= {names for _, names, _ in found}
    for place, names, year in found:
        authors = re.split(r", | and ", names)
        assert any(
            f"({year})" in entry and all(author in entry.split(":")[0] for author in authors)
            for entry in BIBLIOGRAPHY
        ), f"{place}: {names} {year}"
