"""What `encode` prints about size and quality."""

import json
from pathlib import Path

import pytest
from fecosplat_cli.encoding_report import quality_fields, say_result
from refusals import assert_refused

from fecocodec.container import inspect
from fecocodec.errors import InputError
from fecocodec.sender.view_quality import DecodedQuality, quality_warnings, stage_warnings

QUALITY = (DecodedQuality((20.0, 22.0)), DecodedQuality((25.5, 24.5)))


def test_sizes_and_quality_of_each_stage(stream_bytes: bytes, capsys: pytest.CaptureFixture[str]) -> None:
    summary = inspect(stream_bytes)
    say_result("scene.fcs: written", summary, QUALITY, ("a.png", "b.png"))
    printed = capsys.readouterr().err
    assert f"  header, cameras and the like: {(len(stream_bytes) - 38) / 1024:.2f} KiB\n" in printed
    assert "  stage 1:     0.02 KiB   21.00 dB\n" in printed and "  stage 2:     0.01 KiB   25.00 dB\n" in printed
    assert f"  in all:  {len(stream_bytes) / 1024:8.2f} KiB   25.00 dB, PSNR of the 2 coded views" in printed
    assert "(worst 24.50 dB, b.png) as decoded\n" in printed


def test_the_share_of_detail_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    data = (Path(__file__).parents[2] / "bitstream_spec" / "vectors" / "valid" / "detail-of-one-stage.fcs").read_bytes()
    summary = inspect(data)
    (detail,) = [section.total_bytes for section in summary.sections if section.name == "detail"]
    say_result("scene.fcs: written", summary, (DecodedQuality((20.0, 22.0, 21.0)),), ("a.png", "b.png", "c.png"))
    assert f"   21.00 dB ({detail / 1024:.2f} KiB of it detail)\n" in capsys.readouterr().err


def test_the_same_as_json(stream_bytes: bytes) -> None:
    fields = quality_fields(inspect(stream_bytes), QUALITY, ("a.png", "b.png"))
    assert fields["context_psnr"] == 25.0
    assert [stage["context_psnr"] for stage in fields["stage_results"]] == [21.0, 25.0]
    assert fields["context_views"] == [{"name": "a.png", "psnr": 25.5}, {"name": "b.png", "psnr": 24.5}]


def test_warnings_come_before_the_work(
    fecosplat, photographs: Path, output: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those from headers of images come first, then those from pixels; both before the encoder starts."""

    def stop(*_arguments: object, **_options: object) -> bytes:
        raise InputError("the encoder was started.")

    monkeypatch.setattr("fecocodec.codec.encode_views.encode", stop)
    result = fecosplat("encode", photographs, "-o", output / "a.fcs", "--views", "0", "--size", "64x96")
    assert (result.code, result.out) == (1, "")
    assert result.err.splitlines() == [
        "warning: the crop to 64x96 leaves 44% of view_0.png (96x64); choose a --size of the photographs' shape to "
        "keep more.",
        "warning: one view has no parallax, so its depth is unreliable; add a view from another position.",
        f"fecosplat: {photographs}: the encoder was started.",
    ]


ONE_VIEW = ("--views", "0", "--effort", "fast", "--stages", "1")
NO_PARALLAX = "one view has no parallax, so its depth is unreliable; add a view from another position"
ERROR = "(--strict makes this warning an error)."


@pytest.mark.usefixtures("networks")
def test_strict_makes_a_warning_an_error(fecosplat, photographs: Path, output: Path) -> None:
    result = fecosplat("encode", photographs, "-o", output / "a.fcs", *ONE_VIEW, "--strict")
    assert_refused(result, output, f"{photographs}: {NO_PARALLAX} {ERROR}")


@pytest.mark.usefixtures("networks")
def test_strict_covers_the_decoded_views_and_keeps_an_older_file(
    fecosplat, photographs: Path, output: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Untrained networks decode to poor views; this warning is the last one, after the file is coded."""
    monkeypatch.setattr("fecocodec.sender.encode.overlap_warnings", lambda *_arguments: ())
    monkeypatch.setattr("fecocodec.codec.encode_folder.stage_warnings", lambda *_arguments: ())
    arguments = ("encode", photographs, "-o", output / "a.fcs", "--views", "0,1", "--effort", "fast", "--json")
    (warning,) = json.loads(fecosplat(*arguments).out)["warnings"]
    (output / "a.fcs").write_bytes(b"precious")
    assert warning.startswith("the decoded views are poor")
    result = fecosplat(*arguments, "--strict", "--overwrite")
    assert (result.code, result.out) == (1, "")
    assert result.err == f"fecosplat: {photographs}: {warning.removesuffix('.')} {ERROR}\n"
    assert (output / "a.fcs").read_bytes() == b"precious"


@pytest.mark.usefixtures("networks")
def test_strict_without_a_warning_changes_nothing(
    fecosplat, photographs: Path, output: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fecocodec.codec.encode_folder.quality_warnings", lambda *_arguments: ())
    monkeypatch.setattr("fecocodec.codec.encode_folder.stage_warnings", lambda *_arguments: ())
    monkeypatch.setattr("fecocodec.sender.encode.overlap_warnings", lambda *_arguments: ())
    for name, strict in (("a.fcs", ()), ("b.fcs", ("--strict",))):
        result = fecosplat("encode", photographs, "-o", output / name, "--views", "0,1", "--effort", "fast", *strict)
        assert result.code == 0 and "warning:" not in result.err
    assert (output / "a.fcs").read_bytes() == (output / "b.fcs").read_bytes()


def test_poor_views_are_said() -> None:
    assert quality_warnings(DecodedQuality((25.0, 19.0)), ("a.png", "b.png")) == ()
    assert quality_warnings(DecodedQuality((23.0, 18.9)), ("a.png", "b.png")) == (
        "the decoded views are poor, with a PSNR of 20.9 dB (worst b.png, 18.9 dB), and images between them will be "
        "worse; check that each camera belongs to its photograph, or use a smaller lambda, a larger `size`, more "
        "`effort`, or two views closer together.",
    )
    assert quality_warnings(DecodedQuality((23.0, 18.9, 21.0)), ("a.png", "b.png", "c.png")) == (
        "the decoded views are poor, with a PSNR of 21.0 dB (worst b.png, 18.9 dB), and images between them will be "
        "worse; check that each camera belongs to its photograph, or choose fewer `views`, which are closer together, "
        "or use more `effort`.",
    )
    assert quality_warnings(DecodedQuality((18.0,)), ("a.png",)) == (
        "the decoded views are poor, with a PSNR of 18.0 dB; use a smaller lambda, a larger `size` or more `effort`.",
    )


def test_a_second_stage_that_does_harm_is_said() -> None:
    better, worse = DecodedQuality((30.0, 28.0)), DecodedQuality((29.0, 28.0))
    assert stage_warnings((worse, better)) == stage_warnings((better,)) == ()
    assert stage_warnings((better, DecodedQuality((29.9, 28.0)))) == ()
    assert stage_warnings((better, worse)) == (
        "stage 2 lowers the PSNR of the decoded views from 29.00 to 28.50 dB; `stages=1` gives a better file.",
    )
