"""Strictness of the whole suite: float64 unless a test says otherwise, no silent rank promotion."""

import contextlib
import ctypes
import dataclasses
import functools
import gc
import os
import shutil
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

# The suite's processes and kernels, which start with these, keep what a compilation frees of small
# blocks for the next one, and do not wait for threads of linear algebra on the other's core.
os.environ.setdefault("MALLOC_TOP_PAD_", str(2**28))
os.environ.setdefault("MALLOC_TRIM_THRESHOLD_", str(2**32))
TUNABLES = "glibc.malloc.tcache_count=20000:glibc.malloc.hugetlb=1"  # together a twentieth
os.environ.setdefault("GLIBC_TUNABLES", TUNABLES)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Lines of the code are not noted in programs.
os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")

# Programs that one of the suite's processes has compiled serve the others; set before JAX starts.
if "PYTEST_XDIST_WORKER" not in os.environ and "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    CACHE = tempfile.mkdtemp(prefix="jaxpound-tests-")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = CACHE
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.05"
else:
    CACHE = None

# Nearly all of the suite's time is compilation. XLA's older way to make kernels and LLVM without
# optimisation make it 2.5 times as fast; programs for one thread, as the other core is the other
# process's, 1.2 times. Runs are slower, which matters little here. That users' programs, compiled
# without these options, give the same numbers is tested in test_package.py.
SOON = (
    "--xla_cpu_use_fusion_emitters=false --xla_backend_optimization_level=0"
    " --xla_cpu_parallel_codegen_split_count=1 --xla_cpu_multi_thread_eigen=false"
)
if version("jax").startswith("0.10."):  # an unknown flag would end the process
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {SOON}"

# Tracing makes many small objects and few cycles; looking for these often costs a fifth of it.
gc.set_threshold(50_000, 20, 20)

import jax  # noqa: E402
import jaxtyping  # noqa: E402
import nbmake.nb_run  # noqa: E402
import pytest  # noqa: E402
from hypothesis import HealthCheck, settings  # noqa: E402
from traitlets.config import Config  # noqa: E402
from xdist.scheduler import LoadScopeScheduling  # noqa: E402

# Notebooks of two processes start at once. Sockets and a profile of its own for each process: two
# kernels must neither pick the same port nor create the same profile.
KERNELS = tempfile.mkdtemp(prefix="jaxpound-kernels-")
os.environ["IPYTHONDIR"] = KERNELS
STARTUP = Path(KERNELS, "profile_default", "startup", "as_the_suite.py")  # run by every kernel
STARTUP.parent.mkdir(parents=True)
STARTUP.write_text(
    f"import dataclasses, gc\n\ngc.set_threshold{gc.get_threshold()}\n"
    "from jaxpound._xla import plan\n\n"
    "plan.choose(lambda work: dataclasses.replace(plan.looped(work), shortcut='none'))\n"
)
LOCAL = {"transport": "ipc", "ip": f"{KERNELS}/kernel"} if os.name == "posix" else {}
nbmake.nb_run.NotebookClient = functools.partial(
    nbmake.nb_run.NotebookClient,
    config=Config(KernelManager=LOCAL, NotebookClient={"startup_timeout": 300}),
)

# Annotations of these wings are checked at every call, shapes included, in the wings' own tests:
# elsewhere that would double the time of tracing. Nor are they in the files of the largest
# programs, as smaller ones of other files have the same functions. A whole number may stand for a
# float, as it may for mypy.
CHECKED = tuple(Path(__file__).parent / wing for wing in ("_xla", "results", "simulation"))
LARGE = (
    "contact",
    "dampers",
    "dashpots",
    "divergence",
    "faces",
    "impacts",
    "inerters",
    "plans",
    "rows",
)
LARGE += ("systems", "weights")
CHECKER = "beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))"
jaxtyping.install_import_hook([f"jaxpound.{path.name}" for path in CHECKED], CHECKER)
from jaxpound._checks import machine_memory  # noqa: E402
from jaxpound._xla import plan, programs  # noqa: E402

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")

# Steps of all programs are a loop, which compiles in half the time; in those of commands, and where
# a test chooses so, they are laid out as in users'. All plans agree: simulation/test_plans.py.
plan.choose(plan.looped)


def without_shortcut(work):
    """As ``looped``; batches with contact have one loop over the steps, not two."""
    return dataclasses.replace(plan.looped(work), shortcut="none")


# Notes of a slow machine on its compilations are asserted in test_programs.py alone.
programs.AFTER = 600.0  # s

# Every example may compile a program: time is no measure of a test here, and runs must repeat.
settings.register_profile(
    "jaxpound",
    deadline=None,
    derandomize=True,
    max_examples=25,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("jaxpound")

TOGETHER = {"test_divergence.py": "test_impacts.py"}
"""Files, by the names of others whose programs they share: one process runs both."""

FIRST = ("notebooks", "_xla", "simulation", "reliability", "design", "cli", "study", "tests")
"""Folders of long files: these come first, so that no process ends long after the other."""


def pytest_addoption(parser):
    parser.addoption("--thorough", action="store_true", help="and the tests of tests/thorough.txt")


def pytest_collection_modifyitems(config, items):
    places = {folder: place for place, folder in enumerate(FIRST)}
    items.sort(key=lambda item: places.get(item.path.parent.name, len(places)))
    lines = Path(__file__).with_name("thorough.txt").read_text("utf-8").splitlines()
    thorough = {line for line in lines if not line.startswith("#")}
    if not any("::" in argument for argument in config.args):  # whole files
        files, names = {item.nodeid.partition("::")[0] for item in items}, {x.nodeid for x in items}
        gone = [x for x in thorough - names if x.partition("::")[0] in files]
        if gone:
            raise pytest.UsageError(f"tests/thorough.txt names no tests: {', '.join(gone)}")
        if not config.getoption("thorough"):
            left_out = [item for item in items if item.nodeid in thorough]
            config.hook.pytest_deselected(items=left_out)
            items[:] = [item for item in items if item.nodeid not in thorough]


class ByFile(LoadScopeScheduling):
    """One process runs a file, whose tests share fixtures and programs.

    xdist writes its own groups into the names of tests, which pytest 9.2 does not let it change.
    """

    def _split_scope(self, nodeid):
        folder, _, name = nodeid.partition("::")[0].rpartition("/")
        return f"{folder}/{TOGETHER.get(name, name)}"


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    return ByFile(config, log)


@pytest.fixture(autouse=True)
def _checked(request):
    """Wrong types reach the function, in tests that hand them over on purpose."""
    marked = request.node.get_closest_marker("unchecked") is not None
    own = any(folder in request.path.parents for folder in CHECKED)
    checked = own and request.path.stem.removeprefix("test_") not in LARGE and not marked
    jaxtyping.config.update("jaxtyping_disable", not checked)


@pytest.fixture(autouse=True, scope="module")
def _batches_are_soon_compiled(request):
    """Wings that use runs batch them without the shortcut, which runs' own tests take."""
    wing = any(folder in request.path.parents for folder in CHECKED)
    with plan.chosen(plan.looped if wing else without_shortcut):
        yield


@pytest.fixture(autouse=True)
def _figures_do_not_pile_up():
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


MOST_RESIDENT = machine_memory() / 12
"""Bytes that a process of the suite may keep from one file to the next: programs fill them."""


@pytest.fixture(autouse=True, scope="module")
def _programs_do_not_pile_up():
    """Drop compiled programs between files where many have gathered; files share few of them."""
    yield
    status = Path("/proc/self/statm")
    if status.exists():  # on Linux
        resident = int(status.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
        if resident > MOST_RESIDENT:
            jax.clear_caches()
            gc.collect()
            with contextlib.suppress(OSError, AttributeError):
                ctypes.CDLL(None).malloc_trim(0)  # else the C library keeps the memory


@pytest.fixture
def small_machine(monkeypatch):
    """A machine of 24 GB, whatever this one has."""
    monkeypatch.setattr("jaxpound._checks.machine_memory", lambda: 24 * 10**9)


def pytest_unconfigure():
    shutil.rmtree(KERNELS, ignore_errors=True)
    if CACHE:
        shutil.rmtree(CACHE, ignore_errors=True)
