"""What `encode` prints about size and quality."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from fecosplat_cli.encode import report_fields, roles_note, say_result
from fecosplat_cli.output import in_options

from fecocodec.codec.encode_folder import EncodingReport, OtherViews
from fecocodec.container import inspect
from fecocodec.errors import InputError
from fecocodec.sender.view_quality import (
    DecodedQuality,
    LeftOutQuality,
    is_lowered_by_stage_2,
    left_out_warnings,
    new_view_warnings,
    quality_warnings,
    stage_2_note,
    worst_view_warnings,
)

FAST = ("--effort", "fast", "--stages", "1")
QUALITY = (DecodedQuality((20.0, 22.0)), DecodedQuality((25.5, 24.5)))


def report(names: tuple[str, ...], quality: tuple[DecodedQuality, ...], **others: object) -> EncodingReport:
    fields = {
        "guides": OtherViews(),
        "checks": OtherViews(),
        "left_out": None,
        "unused": {},
        "is_fitted": False,
    } | others
    return EncodingReport(b"", names, quality, **fields, notes=(), warnings=(), seconds=1.0, save_cameras=None)


def test_sizes_quality_and_detail_are_said(stream_bytes: bytes, capsys: pytest.CaptureFixture[str]) -> None:
    summary = inspect(stream_bytes)
    say_result("scene.fcs", report(("a.png", "b.png"), QUALITY), summary)
    printed = capsys.readouterr().err
    assert printed.startswith(f"scene.fcs: {len(stream_bytes) / 1024:.2f} KiB in 1.00 s\n")
    assert f"  header, cameras and the like: {(len(stream_bytes) - 38) / 1024:.2f} KiB\n" in printed
    assert "  stage 1:     0.02 KiB   21.00 dB\n" in printed and "  stage 2:     0.01 KiB   25.00 dB\n" in printed
    assert f"  in all:  {len(stream_bytes) / 1024:8.2f} KiB   25.00 dB, PSNR of the 2 coded views" in printed
    assert printed.endswith("(worst 24.50 dB, b.png) as decoded\n")
    checks = OtherViews(("c.png", "d.png"), DecodedQuality((23.0, 22.0)))
    say_result("scene.fcs", report(("a.png", "b.png"), QUALITY, checks=checks), inspect(stream_bytes))
    *_, of_coded, of_new = capsys.readouterr().err.splitlines()
    assert of_new == (
        "  new views:              22.50 dB, PSNR of new views, measured on 2 photographs that were not used, "
        "c.png, d.png (worst 22.00 dB, d.png)"
    )
    assert of_coded.index("dB") == of_new.index("dB")
    data = (Path(__file__).parents[2] / "bitstream_spec" / "vectors" / "valid" / "detail-of-one-stage.fcs").read_bytes()
    summary = inspect(data)
    (detail,) = [section.total_bytes for section in summary.sections if section.name == "detail"]
    quality = (DecodedQuality((20.0, 22.0, 21.0)),)
    say_result("scene.fcs", report(("a.png", "b.png", "c.png"), quality), summary)
    assert f"   21.00 dB ({detail / 1024:.2f} KiB of it detail)\n" in capsys.readouterr().err
    say_result(
        "scene.fcs", report(("a.png",), (DecodedQuality((20.0,)), DecodedQuality((25.0,)))), inspect(stream_bytes)
    )
    assert "25.00 dB, PSNR of the coded view of 448x256 as decoded\n" in capsys.readouterr().err
    checks = OtherViews(("c.png",), DecodedQuality((24.0,)))
    summary, found = inspect(stream_bytes), report(("a.png", "b.png"), QUALITY, checks=checks, is_fitted=True)
    say_result("scene.fcs", found, summary)
    assert "measured on one photograph that was not used, c.png, to which lambda is fitted\n" in capsys.readouterr().err
    assert report_fields(found, summary)["new_view_psnr_is_fitted"] is True


def test_the_same_as_json(stream_bytes: bytes) -> None:
    guides = OtherViews(("c.png",), DecodedQuality((24.0,)))
    checks = OtherViews(("d.png", "e.png"), DecodedQuality((23.0, 22.0)))
    fields = report_fields(report(("a.png", "b.png"), QUALITY, guides=guides, checks=checks), inspect(stream_bytes))
    assert (fields["context_psnr"], fields["new_view_psnr"]) == (25.0, 22.5)
    assert [stage["context_psnr"] for stage in fields["stage_results"]] == [21.0, 25.0]
    assert fields["context_views"] == [{"name": "a.png", "psnr": 25.5}, {"name": "b.png", "psnr": 24.5}]
    assert fields["guide_views"] == [{"name": "c.png", "psnr": 24.0}]
    assert fields["check_views"] == [{"name": "d.png", "psnr": 23.0}, {"name": "e.png", "psnr": 22.0}]


def test_what_the_others_are_for_is_said() -> None:
    alone = report(("a.png", "b.png"), QUALITY)
    assert roles_note(alone, is_chosen=True) == ""
    guided = replace(alone, guides=OtherViews(("c.png", "d.png")), checks=OtherViews(("e.png",)))
    guided = replace(guided, unused={"beyond 2 guides": ("f.png",), "`guides` is none": tuple("ghijk")})
    others = (
        "of the others, 2 guide the encoder, 1 measures new views, 6 are not used (beyond 2 guides: f.png; --guides is "
        "none: g, h, i and 2 more)."
    )
    assert roles_note(guided, is_chosen=False) == others
    assert roles_note(guided, is_chosen=True) == f"coded views: a.png, b.png; {others}"


def test_warnings_come_before_the_work(fecosplat, photographs, output, monkeypatch) -> None:
    """Those from headers of images come first, then those from pixels; both before the encoder starts."""

    def stop(*_arguments: object, **_options: object) -> bytes:
        raise InputError("the encoder was started.")

    monkeypatch.setattr("fecocodec.codec.encode_views.encode", stop)
    result = fecosplat(
        "encode", photographs, "-o", output / "a.fcs", "--views", "view_0.png", "--size", "64x96", "--guides", "none"
    )
    assert (result.code, result.out) == (1, "")
    assert result.err.splitlines() == [
        "warning: the crop to 64x96 leaves 44% of view_0.png (96x64); choose a --size of the photographs' shape to "
        "keep more.",
        "warning: one view has no parallax, so its depth is unreliable; add a view from another position.",
        f"fecosplat: {photographs}: the encoder was started.",
    ]


@pytest.mark.usefixtures("networks")
def test_strict_covers_the_decoded_views_and_keeps_an_older_file(fecosplat, photographs, output, monkeypatch) -> None:
    """Untrained networks decode to poor views; this warning is the last one, after the file is coded."""
    monkeypatch.setattr("fecocodec.sender.encode.overlap_warnings", lambda *_arguments: ())
    arguments = ("encode", photographs, "-o", output / "a.fcs", "--views", "0,1", *FAST, "--json")
    (warning,) = json.loads(fecosplat(*arguments).out)["warnings"]
    (output / "a.fcs").write_bytes(b"precious")
    assert warning.startswith("the decoded views are poor")
    result = fecosplat(*arguments, "--strict", "--overwrite")
    assert (result.code, result.out) == (1, "")
    error = f"{photographs}: {warning.removesuffix('.')} (--strict makes this warning an error)."
    assert result.err.splitlines()[-1] == f"fecosplat: {error}"
    assert (output / "a.fcs").read_bytes() == b"precious"


def test_poor_views_are_said() -> None:
    assert quality_warnings(DecodedQuality((25.0, 19.0)), ("a.png", "b.png")) == ()
    assert quality_warnings(DecodedQuality((23.0, 18.9)), ("a.png", "b.png")) == (
        "the decoded views are poor, with a PSNR of 20.9 dB (worst b.png, 18.9 dB), and images between them will be "
        "worse; use `effort=best`, use a smaller lambda, use a larger `size`, choose two views closer together, or "
        "check that each camera belongs to its photograph.",
    )
    three = DecodedQuality((23.0, 18.9, 21.0)), ("a.png", "b.png", "c.png")
    assert quality_warnings(*three, "best") == (
        "the decoded views are poor, with a PSNR of 21.0 dB (worst b.png, 18.9 dB), and images between them will be "
        "worse; choose fewer `views`, which are closer together, or check that each camera belongs to its photograph.",
    )
    assert quality_warnings(DecodedQuality((18.0,)), ("a.png",), "fast") == (
        "the decoded views are poor, with a PSNR of 18.0 dB; leave out `effort=fast`, use a "
        "smaller lambda, or use a larger `size`.",
    )
    assert in_options("use `effort=best`, no `effort=fast`") == "use --effort best, no --effort fast"


def test_what_helps_new_views_fits_the_case() -> None:
    poor, names = DecodedQuality((18.0, 17.0)), ("a.png", "b.png")
    assert new_view_warnings(DecodedQuality((25.0, 15.0)), names, 4, True) == ()
    start = (
        "new views are poor, with a PSNR of 17.5 dB, measured on 2 photographs that were not used (worst b.png, 17.0 "
        "dB); "
    )
    between, check = "add photographs between the coded ones", "or check that each camera belongs to its photograph."
    assert new_view_warnings(poor, names, 4, True) == (f"{start}{between}, code more of them by `views`, {check}",)
    assert new_view_warnings(poor, names, 4, False) == (f"{start}{between}, {check}",)
    assert new_view_warnings(poor, names, 4, False, "fast") == (f"{start}leave out `effort=fast`, {between}, {check}",)
    assert new_view_warnings(poor, names, 16, True) == (
        f"{start}{between}, encode a smaller part of the scene, as a file holds at most 16 coded views, {check}",
    )
    (of_one,) = new_view_warnings(DecodedQuality((19.4,)), ("a.png",), 4, False)
    assert "19.4 dB, measured on one photograph that was not used (a.png); add photographs" in of_one


def test_a_view_that_is_far_worse_than_the_others_is_named() -> None:
    names = ("a.png", "b.png", "c.png")
    assert worst_view_warnings(DecodedQuality((25.0, 12.9, 26.0)), names) == (
        "b.png is decoded far worse than the other views: it has a PSNR of 12.9 dB, they have 25.5 dB; add photographs "
        "beside it, leave it out by `views`, or check that its camera belongs to it.",
    )
    for fine in ((35.0, 28.0, 36.0), (24.0, 19.0, 24.0), (25.0, 12.9)):
        assert worst_view_warnings(DecodedQuality(fine), names) == ()


def test_nobody_is_asked_to_check_cameras_that_were_estimated() -> None:
    names, poor = ("a.png", "b.png", "c.png"), DecodedQuality((18.0, 10.0, 18.0))
    found = (
        *quality_warnings(poor, names, are_estimated=True),
        *new_view_warnings(poor, names, 4, True, are_estimated=True),
        *worst_view_warnings(poor, names, are_estimated=True),
        *left_out_warnings(LeftOutQuality({0: 14.0, 1: 14.5}, 0.6), names, are_estimated=True),
        *left_out_warnings(LeftOutQuality({0: 24.0, 1: 24.0, 2: 12.0}, 0.6), names, are_estimated=True),
    )
    of_scene = "or take photographs that overlap more (the estimated cameras may be wrong)."
    of_view = "add photographs beside it, or leave it out by `views`."
    ends = (of_scene, of_scene, of_view, of_scene, of_view)
    assert all(sentence.endswith(end) for sentence, end in zip(found, ends, strict=True))


def test_a_stage_that_lowers_the_quality_is_said() -> None:
    better, worse = DecodedQuality((30.0, 28.0)), DecodedQuality((29.0, 28.0))
    assert not is_lowered_by_stage_2((worse, better)) and not is_lowered_by_stage_2((better,))
    assert not is_lowered_by_stage_2((better, DecodedQuality((29.9, 28.0))))
    assert is_lowered_by_stage_2((better, worse))
    assert stage_2_note((better, worse)) == (
        "stage 2 would lower the PSNR of the decoded views from 29.00 to 28.50 dB; the file holds stage 1 alone."
    )


def test_views_that_do_not_predict_each_other_are_said(stream_bytes: bytes, capsys: pytest.CaptureFixture[str]) -> None:
    poor = LeftOutQuality({0: 14.0, 1: 14.5}, 0.6)
    assert left_out_warnings(LeftOutQuality({0: 14.0, 1: 20.0}, 0.2), ("a.png", "b.png")) == ()
    assert left_out_warnings(poor, ("a.png", "b.png")) == (
        "new views will be poor: each coded view, rendered from the others alone, has a PSNR of 14.2 dB where they "
        "show it; add photographs between them, or check that each camera belongs to its photograph.",
    )
    one = LeftOutQuality({0: 21.0, 2: 24.0, 4: 16.5}, 0.6)
    assert left_out_warnings(one, "abcde") == (
        "e does not fit the other views: from their Gaussians alone it has a PSNR of 16.5 dB, they have 22.5 dB; add "
        "photographs beside it, leave it out by `views`, or check that its camera belongs to it.",
    )
    assert left_out_warnings(LeftOutQuality({0: 21.0, 2: 24.0, 4: 16.6}, 0.6), "abcde") == ()
    assert left_out_warnings(LeftOutQuality({0: 24.0, 1: 12.0}, 0.6), "ab") == ()
    summary, found = inspect(stream_bytes), report(("a.png", "b.png"), QUALITY, left_out=poor)
    say_result("scene.fcs", found, summary)
    line = "  from the others:        14.25 dB, PSNR of coded views without their own Gaussians, where the others show"
    assert f"{line} them (60% of their pixels)\n" in capsys.readouterr().err
    assert report_fields(found, summary)["left_out_psnr"] == 14.25
