"""The rules that keep a part findable and the light parts light."""

import ast
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())

# Rule 3: a foreign library that can change under us is known to one place only.
HOME_OF_LIBRARY = {
    "constriction": ("fecocodec/entropy/symbol_coders.py",),
    "zstandard": ("fecocodec/container/", "fecocodec/splat_files/spz.py", "bitstream_spec/"),
    "OpenEXR": ("fecocodec/photographs/exr.py",),
    "av": (
        "fecocodec/photographs/video_writing.py",
        "fecocodec/photographs/video_frames.py",
        "fecocodec/photographs/video_pixels.py",
    ),
    "imagecodecs": ("fecocodec/photographs/png16.py", "fecocodec/evaluation/"),
    "pillow_heif": ("fecocodec/photographs/pillow_images.py",),
    "PIL": ("fecocodec/photographs/", "fecocodec/poses/", "fecocodec/splat_files/"),
    "gsplat": ("fecocodec/rendering/cuda.py",),
    # The receiver needs scipy for its neighbour search alone.
    "scipy": (
        "fecocodec/camera_files/",
        "fecocodec/evaluation/",
        "fecocodec/geometry/neighbours.py",
        "fecocodec/geometry/point_tracks.py",
        "fecocodec/poses/",
        "fecocodec/splat_files/",
        "fecocodec/training/",
    ),
    "safetensors": ("fecocodec/checkpoint.py",),
    "onnxruntime": ("fecocodec/runtime/graphs.py", "bitstream_spec/read_gaussians.py"),
    "onnx": ("fecocodec/training/graphs/",),
    "onnxscript": ("fecocodec/training/graphs/",),
    "dask": ("fecocodec/batch/cluster.py",),
    "distributed": ("fecocodec/batch/cluster.py",),
    "click": ("cli/",),
    "rich": ("cli/",),
}


def python_files(folder: str) -> list[Path]:
    return sorted((ROOT / folder).rglob("*.py"))


@cache
def imported_libraries(file: Path) -> set[str]:
    """Top-level names of everything a file imports, wherever in the file the import stands."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names.update(alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module.partition(".")[0])
    return names


@pytest.mark.parametrize(("library", "homes"), HOME_OF_LIBRARY.items(), ids=HOME_OF_LIBRARY.keys())
def test_library_has_one_home(library: str, homes: tuple[str, ...]) -> None:
    users = [
        file.relative_to(ROOT).as_posix()
        for folder in ("cli", "fecocodec", "bitstream_spec")
        for file in python_files(folder)
        if library in imported_libraries(file)
    ]
    assert [user for user in users if not user.startswith(homes)] == []


def test_the_specification_imports_nothing_of_ours_and_every_package_is_distributed() -> None:
    for file in python_files("bitstream_spec"):
        assert imported_libraries(file).isdisjoint({"fecocodec", "cli", "fecosplat_cli"}), file
    found = {".".join(file.parent.relative_to(ROOT).parts) for file in (ROOT / "fecocodec").rglob("__init__.py")}
    assert found | {"fecosplat_cli"} == set(PYPROJECT["tool"]["setuptools"]["packages"])


def test_import_contracts_hold() -> None:
    lint_imports = Path(sys.executable).with_name("lint-imports")
    result = subprocess.run([lint_imports, "--no-cache"], cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr


IMPORT_ALL = """
import importlib, pkgutil, {0}
for found in pkgutil.walk_packages({0}.__path__, "{0}."):
    importlib.import_module(found.name)
"""
RUN = "from fecosplat_cli.main import run; assert run({}) == 0"
SCENE = str(next((ROOT / "bitstream_spec" / "vectors" / "valid").glob("scene-*.fcs")))


@pytest.mark.parametrize(
    ("statements", "libraries"),
    [
        ("import fecocodec, fecocodec.codec.encode_folder, fecosplat_cli.main", ("torch",)),
        *((IMPORT_ALL.format(name), ("torch",)) for name in ("fecocodec.container", "fecocodec.entropy")),
        (RUN.format(["--help"]), ("torch", "numpy", "rich")),
        ("from fecocodec import decode, write_ply", ("torch",)),
        (RUN.format(["info", SCENE]), ("torch", "numpy", "numba", "scipy")),
    ],
)
def test_libraries_stay_unloaded(statements: str, libraries: tuple[str, ...]) -> None:
    """In a fresh process."""
    program = f"import sys\n{statements}\nprint([name for name in {libraries} if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert result.stdout.splitlines()[-1] == "[]"


def test_library_neither_prints_nor_exits() -> None:
    """Rule 4. The command line and the specification's own tool are where talking to a terminal belongs."""
    offenders = [
        f"{file.relative_to(ROOT)}:{node.lineno}"
        for file in python_files("fecocodec")
        if file.name != "__main__.py"  # not the library: what `python -m fecocodec` runs
        for node in ast.walk(ast.parse(file.read_text()))
        if (isinstance(node, ast.Call) and ast.unparse(node.func) in {"print", "exit", "sys.exit", "os.getenv"})
        or (isinstance(node, ast.Attribute) and ast.unparse(node) == "os.environ")
    ]
    assert offenders == []
