"""Cheap errors come before any large library is loaded; input that cannot be read exits with 1, wrong usage with 2."""

import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import click
import pytest
from fecosplat_cli.options import parse_guides, parse_selection
from fecosplat_cli.output import in_options, warn

from fecocodec.captures.view_selection import Spread
from fecocodec.splat_files import html_page

# Runs many command lines, one after the other, and prints code, standard output and standard error of each as JSON.
NO_TORCH = """
import contextlib, io, json, sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("torch", "onnxruntime"):
            raise ImportError(name)

sys.meta_path.insert(0, Blocked())
from fecosplat_cli.main import run

def result(arguments):
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = run(arguments)
    return code, out.getvalue(), err.getvalue()

print(json.dumps([result(arguments) for arguments in json.load(sys.stdin)]))
"""


EARLY = [
    (("encode", "missing", "-o", "a.fcs"), "missing: no such folder; check the path."),
    (("encode", "missing.mp4", "-o", "a.fcs"), "missing.mp4: no such file; check the path."),
    (("encode", ".", "-o", "."), ".: this is a folder; give the name of a file, such as NAME."),
    (("encode", ".", "-o", "a.splat"), "a.splat: files of kind .splat are not written here; use .fcs."),
    (("encode", ".", "-o", "in.fcs/a.fcs"), "in.fcs/a.fcs: in.fcs is not a folder; choose another output path."),
    (("encode", ".", "-o", "a.fcs", "--lambda", "7"), "lambda is 7"),
    (
        ("encode", ".", "-o", "a.fcs", "--lambda", "nan"),
        "lambda is nan, outside the range of the codec; choose one from 1e-05 to 0.01.",
    ),
    (("encode", ".", "-o", "a.fcs", "--title", "a" * 70000), "section metadata: its JSON has 70012 bytes, at most"),
    (
        ("decode", "missing", "-o", "a.obj"),
        "a.obj: files of kind .obj are not written here; use .ply or .compressed.ply or .spz or .sog or .glb or .html.",
    ),
    (("decode", "missing", "-o", "a.ply"), "missing: there is no such file; check the path."),
    (("render", "missing", "-o", "out"), "missing: there is no such file; check the path."),
    (("render", "in.fcs", "-o", "out", "--cameras", "missing"), "missing: no such folder"),
    (("eval", "missing", "--index", "i.json", "-o", "out"), "missing: there is no such folder; check the path."),
    (("stress", "missing", "--index", "i.json", "-o", "out"), "missing: there is no such folder; check the path."),
    (("render", "in.fcs", "-o", "a.bmp"), "a.bmp: files of kind .bmp are not written here"),
    (("render", "in.fcs", "-o", "out"), "in.fcs: header at byte 0: the file ends after 0 bytes"),
    (("render", "in.fcs", "-o", "out", "--model", "no"), "no: there is no such folder; name the folder of a model."),
    (("encode", ".", "-o", "a.fcs", "--model", "no"), "no: there is no such folder; name the folder of a model."),
    (("eval", "one", "--index", "missing", "-o", "out"), "missing: there is no such file; check the path."),
    (("stress", "one", "--index", "missing", "-o", "out"), "missing: there is no such file; check the path."),
    (("eval", "one", "--index", "i.json", "-o", "out", "--lambdas", "1.0"), "lambda is 1.0, outside the range"),
    (("info", "missing"), "missing: there is no such file; check the path."),
    (("decode", "text.fcs", "-o", "a.ply"), "text.fcs: not a .fcs file: its signature at byte 0 is 68 65 6c 6c 6f"),
    (("decode", "scene.fcs", "-o", "a.ply", "--max-pixels", "9"), "scene.fcs: the views have 229376 pixels in all"),
    (("decode", "scene.fcs", "-o", "a.ply"), "scene.fcs: the stream needs the receiver weights with model id"),
    (("encode", "empty", "-o", "a.fcs"), "empty: no photographs and no camera file found; give a folder that"),
    (("encode", "one/a.png", "-o", "a.fcs"), "one/a.png: a photograph, not a camera file; give a folder of two or"),
    (("encode", "one", "-o", "a.fcs"), "one: one photograph without cameras, but cameras are estimated from two"),
    (("encode", "text.fcs", "-o", "a.fcs"), "text.fcs: not a camera file, nor a video by its name; give"),
    (("encode", "broken", "-o", "a.fcs"), "broken/transforms.json, line 1, column 2: broken JSON"),
    (("encode", "absent", "-o", "a.fcs"), "absent/transforms.json, frame 0 (0.png): there is no image absent/0.png"),
    (("encode", "posed", "-o", "a.fcs", "--views", "9"), "posed: 9 views asked for, but the folder has 3"),
    (("train", "text.fcs"), "text.fcs: this is not a folder; choose another output path."),
    (("train", "run", "--size", "3x3"), "A training image side of 3 pixels cannot be used"),
    (("train", "entropy", "one", "one/a", "--size", "3x3"), "A training image side of 3 pixels cannot be used"),
    (("train", "steps", "one", "one", "--textures", "missing"), "missing: there is no such file or folder; check"),
    (("train", "detail", "absent/a", "b", "--photographs", "one", "--index", "c"), "absent/a: there is no such"),
    (("train", "run", "--views", "77"), "77 context views with share 1 cannot be trained"),
    (("train", "run", "--lambda-range", "7", "8"), "lambda is 7"),
    (("train", "run", "--photographs", "missing"), "missing: there is no such file or folder; check the path."),
    (("eval", "one", "--index", "text.fcs", "-o", "out"), "text.fcs, line 1, column 1: broken JSON"),
    (("stress", "one", "--index", "text.fcs", "-o", "out"), "text.fcs, line 1, column 1: broken JSON"),
]


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory, stream_bytes: bytes) -> dict[tuple[str, ...], list]:
    """For each command line: its exit code, standard output and standard error, of one process without torch."""
    tmp_path = tmp_path_factory.mktemp("early")
    (tmp_path / "in.fcs").write_bytes(b"")
    (tmp_path / "text.fcs").write_text("hello")
    (tmp_path / "scene.fcs").write_bytes(stream_bytes)
    for name in ("empty", "one", "broken", "absent", "posed"):
        (tmp_path / name).mkdir()
    (tmp_path / "one" / "a.png").write_bytes(b"")
    (tmp_path / "broken" / "transforms.json").write_text("{")
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    frames = [{"file_path": f"{number}.png", "transform_matrix": pose} for number in range(3)]
    for name in ("absent", "posed"):
        (tmp_path / name / "transforms.json").write_text(json.dumps({"fl_x": 90, "frames": frames}))
    for frame in frames:
        (tmp_path / "posed" / str(frame["file_path"])).write_text(str(frame["file_path"]))  # no copies of each other
    given = json.dumps([arguments for arguments, _ in EARLY])
    command = [sys.executable, "-c", NO_TORCH]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}  # notes on cameras above photographs end there
    result = subprocess.run(command, input=given, capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert result.returncode == 0, result.stderr
    return dict(zip((arguments for arguments, _ in EARLY), json.loads(result.stdout), strict=True))


@pytest.mark.parametrize(("arguments", "sentence"), EARLY)
def test_without_torch(arguments: tuple[str, ...], sentence: str, answers: dict[tuple[str, ...], list]) -> None:
    code, out, err = answers[arguments]
    assert (code, out) == (1, "")
    assert err.startswith(f"fecosplat: {sentence}") and err.count("\n") == 1


@pytest.mark.parametrize("arguments", [("info",), ("decode", "-o", "a.ply"), ("encode", "-o", "a.fcs")])
def test_a_file_without_permission_is_no_wrong_usage(fecosplat, tmp_path, arguments, monkeypatch) -> None:
    """The superuser may read everything, so the check that the parser of options would make is made to fail."""
    closed = tmp_path / "closed"
    closed.write_bytes(b"")
    monkeypatch.setattr("os.access", lambda *_arguments, **_options: False)
    monkeypatch.chdir(tmp_path)
    assert fecosplat(arguments[0], closed, *arguments[1:]).code == 1


@pytest.mark.parametrize(
    "arguments",
    [("decode", "missing.fcs", "-o", "a.html"), ("batch", "decode", "missing", "-o", "out", "--format", "html")],
)
def test_a_missing_page_is_reported_before_the_file_is_read(fecosplat, tmp_path, arguments, monkeypatch) -> None:
    monkeypatch.setattr(html_page, "scene_page", partial(html_page.scene_page, tmp_path))
    monkeypatch.chdir(tmp_path)
    result = fecosplat(*arguments)
    assert result.code == 1
    assert "the viewer page is missing" in result.err


def test_texts_of_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    context, option = click.Context(click.Command("encode")), click.Option(["--views"])
    assert parse_selection(context, option, r"a\,b.jpg, 2.jpg") == ("a,b.jpg", "2.jpg")
    assert parse_selection(context, option, "7,") == ("7",) and parse_selection(context, option, "7") == Spread(7)
    assert parse_selection(context, option, "9" * 5000) == ("9" * 5000,)  # a name, which Python can make no number of
    guides = {text: parse_guides(context, option, text) for text in ("auto", "none", "4", "4,", "a.jpg,5")}
    assert list(guides.values()) == [None, (), Spread(4), ("4",), ("a.jpg", "5")]
    for text in (",", ",7", "7,,"):
        with pytest.raises(click.BadParameter, match="names an empty view"):
            parse_selection(context, option, text)
    assert in_options("change `views` or `size`; not `file_path`.") == "change --views or --size; not `file_path`."
    warn(f"cameras.json: there is no image {'a' * 5000}.jpg; put it there.")
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("cameras.json: there is no image aaa") and line.endswith("aaa.jpg; put it there.")
    assert "a...a" in line and len(line) < 500
    warn(path := "/" + "/".join(["folder"] * 70))
    assert capsys.readouterr().err == f"{path}\n"


def test_the_library_as_a_module_names_the_command() -> None:
    result = subprocess.run([sys.executable, "-m", "fecocodec"], capture_output=True, text=True)
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr == (
        "fecocodec is the library; run the command as `fecosplat`, or as `python -m fecosplat_cli`.\n"
    )


def test_warnings_of_python_and_numpy_do_not_reach_the_terminal() -> None:
    program = (
        "import fecosplat_cli.main as command\n"
        "def warn(arguments=None):\n"
        "    import warnings, numpy\n"
        "    warnings.warn('for developers'); numpy.float32(1e38) * numpy.float32(1e38); return 0\n"
        "command.run = warn; command.main()"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.parametrize(
    ("systems", "package"), [("codec", "flip_evaluator"), ("images", "imagecodecs"), ("gaussians", "gsply")]
)
def test_missing_packages_are_reported_before_any_work(fecosplat, tmp_path, monkeypatch, systems, package) -> None:
    monkeypatch.setattr("fecocodec.evaluation.extras.find_spec", lambda name: None if name == package else object())
    result = fecosplat("eval", tmp_path / "no", "--index", "no", "-o", tmp_path / "out", "--systems", systems)
    assert (result.code, result.out) == (1, "")
    assert result.err == (
        f"fecosplat: measuring needs packages that are not installed ({package}); run `pip install '.[eval]'` in the "
        "project's folder.\n"
    )


def test_a_name_of_a_model_that_no_folder_can_have(fecosplat, stream_file: Path, output: Path) -> None:
    result = fecosplat("decode", stream_file, "-o", output / "a.ply", "--model", "x" * 5000)
    assert result.code == 1 and result.err.endswith(
        "cannot be read (File name too long); check the path and its permissions.\n"
    )


def test_a_working_folder_that_was_removed(fecosplat, tmp_path, monkeypatch):
    def refuse() -> str:
        raise FileNotFoundError(2, "No such file or directory")

    monkeypatch.setattr("os.getcwd", refuse)
    result = fecosplat("decode", tmp_path / "a.fcs", "-o", "a.ply")
    told = "fecosplat: the working folder was removed; change to another one by `cd`.\n"
    assert (result.code, result.err) == (1, told)
