"""The rooms: imports point one way, heavy packages stay where they are needed, every file has a noun."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import heave_env

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("heave_env", "baselines", "agents", "experiments")  # each imports only those before it
CORE_PACKAGES = {"numpy", "scipy", "numba", "gymnasium", "yaml"}
HOMES = {  # the first room in which a package may be imported
    "torch": "agents",
    "stable_baselines3": "agents",
    "sb3_contrib": "agents",
    "safetensors": "agents",
    "tensorboard": "agents",
    "matplotlib": "experiments",
    "jinja2": "experiments",
    "imageio_ffmpeg": "experiments",
    "moordyn": "experiments",
    "ray": "experiments",
    "optuna": "experiments",
    "daqp": "baselines",
    "clarabel": "baselines",
}
LAYERS = (  # inside heave_env, from the bottom; a module imports none above its own layer
    ("parameters", "document", "compiled", "layout", "lanes", "streams", "files", "provenance"),
    ("pool", "mailbox", "workers"),
    ("ropes", "spectra", "shaping", "rao", "sea", "vessel", "winch", "compensator", "hydrodynamics"),
    ("cable",),
    ("sensors", "task", "variants"),
    ("scenarios", "controller"),
    ("kernel",),
    ("marching", "rollouts"),
    ("plant",),
    ("render",),
    ("env",),
    ("gpu",),
)
MODULES = sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))


def imported_modules(path: Path, *, at_top_only: bool = False) -> set[str]:
    """Absolute names of the modules that a file imports, those under TYPE_CHECKING left out."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typing_only = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        for inner in ast.walk(node)
    }
    deferred = {
        inner
        for node in ast.walk(tree)
        if at_top_only and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        for inner in ast.walk(node)
    }
    names = set()
    for node in ast.walk(tree):
        if node in typing_only or node in deferred:
            continue
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            names |= {module} | {f"{module}.{alias.name}" for alias in node.names}
    return names


def top_packages(path: Path, **options: bool) -> set[str]:
    return {name.split(".")[0] for name in imported_modules(path, **options)}


def room_of(path: Path) -> str:
    return path.relative_to(ROOT).parts[0]


def by_name(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", MODULES, ids=by_name)
def test_a_room_imports_only_rooms_before_it(path):
    later = set(ROOMS[ROOMS.index(room_of(path)) + 1 :]) | {"tests"}
    assert not top_packages(path) & later


@pytest.mark.parametrize("path", MODULES, ids=by_name)
def test_heavy_packages_stay_in_their_rooms(path):
    reachable = ROOMS[: ROOMS.index(room_of(path)) + 1]
    misplaced = {name for name in top_packages(path) if name in HOMES and HOMES[name] not in reachable}
    if by_name(path) == "heave_env/render.py":
        misplaced -= {"matplotlib"}
    if by_name(path) == "heave_env/gpu/torch_env.py":
        misplaced -= {"torch"}
    assert not misplaced


@pytest.mark.parametrize("path", sorted((ROOT / "heave_env").rglob("*.py")), ids=by_name)
def test_the_environment_needs_few_packages(path):
    foreign = top_packages(path, at_top_only=True) - set(sys.stdlib_module_names) - {"heave_env"}
    assert foreign <= CORE_PACKAGES


@pytest.mark.parametrize("path", sorted((ROOT / "experiments").rglob("*.py")), ids=by_name)
def test_figures_are_drawn_lazily(path):
    assert "matplotlib" not in top_packages(path, at_top_only=True)


def layer_of(module: str) -> int | None:
    """The layer of `heave_env.<noun>...`, or None for the package itself and for unlisted nouns."""
    parts = module.split(".")
    noun = parts[1] if len(parts) > 1 else ""
    return next((i for i, nouns in enumerate(LAYERS) if noun in nouns), None)


@pytest.mark.parametrize("path", sorted((ROOT / "heave_env").rglob("*.py")), ids=by_name)
def test_inside_the_environment_imports_point_down(path):
    own = layer_of(".".join(path.relative_to(ROOT).with_suffix("").parts))
    if own is None:
        assert path.name == "__init__.py", f"{by_name(path)} is in no layer: say in LAYERS where it belongs"
        return
    for name in imported_modules(path):
        if name.startswith("heave_env."):
            assert (layer_of(name) or 0) <= own, f"{by_name(path)} reaches up to {name}"


def test_files_are_named_after_what_they_hold():
    homeless = {"utils", "util", "helpers", "helper", "common", "misc", "tools"}
    assert not [by_name(path) for path in MODULES if homeless & {path.stem, path.parent.name}]


def test_the_packages_are_the_top_level_folders():
    folders = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {"tests"}
    assert folders == set(ROOMS)


HEAVY = ("torch", "stable_baselines3", "matplotlib", "pygame", "PIL", "tensorboard", "rich", "pandas", "warp")


@pytest.mark.parametrize(
    ("module", "more"),
    [
        # Registering the scenarios compiles nothing; only an environment needs the compiler.
        ("heave_env", ("numba", "scipy", "yaml")),
        ("heave_env.env", ("scipy.signal", "scipy.stats", "scipy.interpolate", "scipy.spatial")),
    ],
)
def test_importing_the_environment_loads_nothing_heavy(module, more):
    heavy = [*HEAVY, *more]
    code = f"import sys, {module}; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.stdout.strip() == "[]", done.stderr


def test_the_citation_file_tells_the_version():
    version = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert version is not None
    assert version[1] == heave_env.__version__


CITATION = re.compile(r"([A-ZÅ]\w+(?: et al\.|(?:, [A-Z]\w+)* and [A-Z]\w+)?) \((\d{4})\)")


def sources_in_full() -> set[tuple[str, str]]:
    """First author's surname (its last word) and year of every source that CONVENTIONS.md lists."""
    listed = (ROOT / "CONVENTIONS.md").read_text(encoding="utf-8").split("## Sources")[1]
    years = (
        (entry.split(",")[0].split()[-1], re.search(r"\((\d{4})\)", entry))
        for entry in listed.split("\n\n")
        if entry
    )
    return {(surname, year[1]) for surname, year in years if year}


@pytest.mark.parametrize("path", MODULES, ids=by_name)
def test_every_cited_source_is_given_in_full(path):
    text = re.sub(r"\s+", " ", path.read_text(encoding="utf-8"))
    for source in re.findall(r"Source: (.{0,400})", text):
        for authors, year in CITATION.findall(source.split(" Args: ")[0]):
            surname = re.split(r" et al\.|,| and ", authors)[0]
            named = f"{authors} ({year}) is not among the sources of CONVENTIONS.md"
            assert (surname, year) in sources_in_full(), named
