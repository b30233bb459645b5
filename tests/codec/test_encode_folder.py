"""`encode_folder`: what the command does, as a call of the library."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

import fecocodec
from fecocodec import AtMostKib, EncodingOptions, InputError, encode_folder
from fecocodec.container import inspect
from fecocodec.errors import OptionError, StrictError
from tests.example_scenes import MODEL, write_scene


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("folder") / "scene"
    write_scene(folder)
    return folder


@pytest.fixture
def options(random_weights: Path) -> EncodingOptions:
    return EncodingOptions(effort="fast", model=random_weights / MODEL)


def test_it_encodes_what_is_in_the_folder_and_says_how_it_went(folder: Path, options: EncodingOptions) -> None:
    steps: list[str] = []
    warnings: list[str] = []
    report = encode_folder(
        folder,
        replace(options, metadata={"title": "A wall"}),
        on_progress=lambda step, _fraction: steps.append(step),
        on_warning=warnings.append,
    )
    views = fecocodec.read_views(folder)
    plain = fecocodec.encode(views, effort="fast", model=options.model)
    assert inspect(report.data).metadata == {"title": "A wall"}
    assert encode_folder(folder, replace(options, is_measured=False)).data == plain
    assert report.names == ("0.png", "1.png") and report.left_out == ()
    assert report.quality == fecocodec.measure_decoded(plain, views, model=options.model)
    assert report.warnings == tuple(warnings) != ()  # untrained networks decode to poor views
    assert steps[:2] == ["reading views", "judging views"] and report.seconds > 0
    assert report.save_cameras is None  # they were given


def test_a_file_that_is_not_measured_has_no_quality(folder: Path, options: EncodingOptions) -> None:
    assert encode_folder(folder, replace(options, is_measured=False)).quality == ()


def test_strict_raises_the_first_warning_and_measures(folder: Path, options: EncodingOptions) -> None:
    first = encode_folder(folder, options).warnings[0]
    with pytest.raises(StrictError) as refused:
        encode_folder(folder, replace(options, is_strict=True, is_measured=False))
    assert str(refused.value) == f"{folder}: {first.removesuffix('.')} (`strict` makes this warning an error)."


@pytest.mark.parametrize(("option", "value"), [("num_frames", 8), ("focal_px", 100.0)])
def test_options_for_another_kind_of_input_are_refused(folder: Path, option: str, value: float) -> None:
    with pytest.raises(OptionError, match=r"`frames` is for a video|`focal_px` is for photographs without cameras"):
        encode_folder(folder, EncodingOptions(**{option: value}))


def test_options_that_exclude_each_other_are_refused_at_once() -> None:
    with pytest.raises(OptionError, match="has no rate control"):
        EncodingOptions(target=AtMostKib(8.0), num_stages=1)
    with pytest.raises(OptionError, match="needs the steps"):
        EncodingOptions(effort="fast", sharpness=0.5)
    with pytest.raises(InputError, match="lambda is 7"):
        EncodingOptions(lmbda=7.0)
    with pytest.raises(fecocodec.BitstreamError, match="section metadata"):
        EncodingOptions(metadata={"title": "a" * 70000})


def test_errors_name_the_folder(folder: Path, options: EncodingOptions) -> None:
    with pytest.raises(InputError, match=f"^{folder}: 3 stages were asked for"):
        encode_folder(folder, replace(options, num_stages=3))


def test_an_unknown_effort_is_refused_before_pixels_are_read(folder: Path, tmp_path: Path) -> None:
    broken = Path(shutil.copytree(folder, tmp_path / "scene"))
    png = (broken / "0.png").read_bytes()
    (broken / "0.png").write_bytes(png[: len(png) // 2])  # its header is whole
    with pytest.raises(InputError, match=r"^there is no effort 'good'"):
        encode_folder(broken, EncodingOptions(effort="good"))
