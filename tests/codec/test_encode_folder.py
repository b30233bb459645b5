"""`encode_folder`: what the command does, as a call of the library."""

import json
import shutil
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from PIL import Image

import fecocodec
from fecocodec import AtLeastNewPsnr, AtMostKib, EncodingOptions, InputError, encode_folder
from fecocodec.captures.view_selection import All, Spread
from fecocodec.checkpoint import RECEIVER_FILE, model_id_of
from fecocodec.codec.encode_folder import OtherViews
from fecocodec.codec.messages import of_input
from fecocodec.codec.scene_source import SceneSource
from fecocodec.config import PAPER, ReceiverConfig, SenderConfig
from fecocodec.container import inspect
from fecocodec.errors import BitstreamError, OptionError, SizeError, StrictError
from fecocodec.evaluation.stress.box_room import Room, look, painted, photograph
from fecocodec.geometry.views import Views
from fecocodec.model_files import is_shipped, model_folder
from fecocodec.receiver.model import Receiver, serialise_receiver
from fecocodec.sender.model import Sender
from fecocodec.training.model_weights import write_model
from tests.example_scenes import MODEL, write_scene, write_views

pytestmark = pytest.mark.usefixtures("found_once")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("folder") / "scene"
    write_scene(folder)
    return folder


@pytest.fixture
def options(random_weights: Path) -> EncodingOptions:
    return EncodingOptions(effort="fast", model=random_weights / MODEL)


def test_a_zip_archive_is_encoded_as_its_folder_and_named_in_what_is_said(folder, options, tmp_path) -> None:
    cameras = json.loads((folder / "transforms.json").read_text())
    cameras["frames"].append({**cameras["frames"][0], "file_path": "images/absent.png"})
    shutil.copytree(folder, tmp_path / "scene")
    (tmp_path / "scene" / "transforms.json").write_text(json.dumps(cameras))
    archive = Path(shutil.make_archive(str(tmp_path / "scan"), "zip", tmp_path, "scene"))
    one_stage = replace(options, num_stages=1)
    report, of_folder = (encode_folder(path, one_stage) for path in (archive, tmp_path / "scene"))
    assert report.data == of_folder.data
    for told, expected in ((report.notes, of_folder.notes), (report.warnings, of_folder.warnings)):
        assert told == tuple(sentence.replace(str(tmp_path / "scene"), str(archive)) for sentence in expected)
    assert any("absent.png" in warning for warning in report.warnings)


def test_it_encodes_what_is_in_the_folder_and_says_how_it_went(folder: Path, options: EncodingOptions) -> None:
    steps: list[str] = []
    warnings: list[str] = []
    report = encode_folder(
        folder,
        replace(options, metadata={"title": "A wall"}),
        on_progress=lambda step, _fraction: steps.append(step),
        on_warning=warnings.append,
    )
    assert inspect(report.data).metadata == {"title": "A wall"}
    assert report.names == ("0.png", "1.png")
    assert inspect(report.data).header.num_stages == len(report.quality) == 1  # stage 2 of untrained networks does harm
    assert report.warnings == tuple(warnings) != ()  # untrained networks decode to poor views
    assert steps[:2] == ["reading views", "matching views"] and report.seconds > 0
    assert report.save_cameras is None  # they were given


def test_a_second_stage_that_does_harm_is_left_out(folder: Path, options: EncodingOptions) -> None:
    views = fecocodec.read_views(folder)
    plain, alone = (fecocodec.encode(views, effort="fast", model=options.model, num_stages=n) for n in (2, 1))
    unmeasured = encode_folder(folder, replace(options, is_measured=False))
    assert (unmeasured.data, unmeasured.quality) == (plain, ())
    first, last = fecocodec.measure_decoded(plain, views, model=options.model)
    report = encode_folder(folder, options)
    assert report.data == alone and report.quality == fecocodec.measure_decoded(alone, views, model=options.model)
    assert report.quality[-1].psnr > last.psnr
    change = f"from {first.psnr:.2f} to {last.psnr:.2f} dB"
    assert f"stage 2 would lower the PSNR of the decoded views {change}; the file holds stage 1 alone." in report.notes


def test_poor_new_views_are_foretold_for_shipped_models_alone(folder, options, monkeypatch) -> None:
    """The threshold was measured with their networks."""
    module = "fecocodec.codec.encode_folder"
    monkeypatch.setattr(f"{module}.quality_warnings", lambda *_arguments, **_options: ())
    monkeypatch.setattr("fecocodec.sender.view_quality.LEAST_LEFT_OUT_PSNR", 100.0)
    one_stage = replace(options, num_stages=1)
    assert not any("new views will be poor" in sentence for sentence in encode_folder(folder, one_stage).warnings)
    monkeypatch.setattr(f"{module}.is_shipped", lambda _model_id: True)
    assert any("new views will be poor" in sentence for sentence in encode_folder(folder, one_stage).warnings)
    shipped = model_id_of((model_folder(None) / RECEIVER_FILE).read_bytes())
    assert is_shipped(shipped) and not is_shipped(bytes(8))


def test_no_other_effort_is_advised_for_a_method_of_one_pass(folder: Path, tmp_path: Path) -> None:
    receiver = Receiver(ReceiverConfig(method=PAPER))
    data = serialise_receiver(receiver)
    write_model(tmp_path, data, Sender(SenderConfig(), receiver.config))
    for effort in ("fast", "default"):
        report = encode_folder(folder, EncodingOptions(effort=effort, model=tmp_path))
        (poor,) = (warning for warning in report.warnings if warning.startswith("the decoded views are poor"))
        assert "worse; use a smaller lambda" in poor and "effort" not in poor


def test_strict_raises_the_first_warning_and_measures(folder: Path, options: EncodingOptions) -> None:
    options = replace(options, num_stages=1)
    first = encode_folder(folder, options).warnings[0]
    with pytest.raises(StrictError) as refused:
        encode_folder(folder, replace(options, is_strict=True, is_measured=False))
    assert str(refused.value) == f"{folder}: {first.removesuffix('.')} (`strict` makes this warning an error)."


def test_guides_that_cannot_be_had_are_said(folder: Path, options: EncodingOptions, monkeypatch) -> None:
    def stop(*_arguments: object, **_options: object) -> bytes:
        raise InputError("the encoder was started.")

    monkeypatch.setattr("fecocodec.codec.encode_views.encode", stop)
    notes: list[str] = []
    for count in (1, 3):
        with pytest.raises(InputError, match="was started"):
            encode_folder(folder, replace(options, views=None, guides=Spread(count)), on_note=notes.append)
    assert notes == [
        "1 guide asked for, but no photograph can guide.",
        "3 guides asked for, but no photograph can guide.",
    ]


@pytest.mark.parametrize(("option", "value"), [("num_frames", 8), ("focal_px", 100.0)])
def test_options_for_another_kind_of_input_are_refused(folder: Path, option: str, value: float) -> None:
    with pytest.raises(OptionError, match=r"`frames` is for a video|`focal_px` is for photographs without cameras"):
        encode_folder(folder, EncodingOptions(**{option: value}))


NAMES_WANTED = "give a tuple of names as text, "


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        *(
            ({name: value}, f"`{name}` is {value!r}; {NAMES_WANTED}")
            for name, value in (
                *(("views", value) for value in (4, "all", Path("a.jpg"), ["a.jpg"], (Path("a.jpg"),))),
                *(("guides", value) for value in (4, "none", Path("a.jpg"))),
            )
        ),
        ({"background": "red"}, "`background` is 'red'; give one of None, 'white', 'black'."),
        ({"masks": "red"}, "`masks` is 'red'; give one of 'leave-out', 'cut-out', 'unused'."),
        ({"num_frames": -1}, "`num_frames` is -1; give a number above 0."),
        ({"focal_px": 0.0}, "`focal_px` is 0; give a number above 0."),
        ({"views": Spread(17)}, "17 `views` asked for, but a file holds 1 to 16"),
        ({"views": All(), "guides": (1,)}, "`views=all` codes every photograph"),
        ({"views": All(), "num_checks": 1}, "`views=all` codes every photograph"),
        ({"target": AtMostKib(8.0), "num_stages": 1}, "`stages=1` has no rate control"),
        (
            {"target": AtLeastNewPsnr(20.0), "num_checks": 0},
            "a PSNR of new views is measured on `checks`, and there are",
        ),
        ({"effort": "fast", "sharpness": 0.5}, "`sharpness` needs the steps"),
        ({"lmbda": 7.0}, "lambda is 7"),
        ({"near": 5.0, "far": 2.0}, "near 5 and far 2 are no range of depths"),
        ({"size": (64, 30)}, "size 30x64: each side must have"),
        ({"metadata": {"title": "a" * 70000}}, "section metadata"),
    ],
)
def test_options_that_no_scene_can_be_encoded_with_are_refused_at_once(values: dict, sentence: str) -> None:
    options = EncodingOptions()
    for name, value in values.items():
        object.__setattr__(options, name, value)  # tests check types at calls, users do not
    with pytest.raises(fecocodec.FecoError) as refused:
        options.__post_init__()
    assert str(refused.value).startswith(sentence)


def test_errors_name_the_folder(folder: Path, options: EncodingOptions) -> None:
    with pytest.raises(InputError, match=f"^{folder}: 3 stages were asked for"):
        encode_folder(folder, replace(options, num_stages=3))


def test_an_unknown_effort_is_refused_before_pixels_are_read(folder: Path, tmp_path: Path) -> None:
    broken = copied(folder, tmp_path / "scene", "0.png")
    with pytest.raises(InputError, match=r"^there is no effort 'good'"):
        encode_folder(broken, EncodingOptions(effort="good"))


def test_a_choice_that_cannot_be_is_refused_before_cameras_are_estimated(folder, tmp_path, monkeypatch) -> None:
    without_cameras = Path(shutil.copytree(folder, tmp_path / "scene"))
    (without_cameras / "transforms.json").unlink()
    monkeypatch.setattr("fecocodec.poses.posed_folder.posed_folder", lambda *_args, **_options: pytest.fail("too late"))
    count = len(list(without_cameras.rglob("*.png")))
    for options, sentence in (
        (EncodingOptions(views=Spread(count + 1)), f"{count + 1} views asked for, but the folder has {count}; "),
        (EncodingOptions(num_checks=20), "20 checks asked for, but no photograph can be left for them; "),
        (EncodingOptions(views=("none.png",)), "no view is called none.png "),
        (EncodingOptions(guides=(99,)), "there is no view 99; "),
    ):
        with pytest.raises(InputError) as refused:
            encode_folder(without_cameras, options)
        assert str(refused.value).startswith(f"{without_cameras}: {sentence}")


@pytest.fixture(scope="module")
def seven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("seven") / "scene"
    poses = torch.stack([look((0.06 * step - 0.18, 0.02 * step, -1.5)) for step in range(7)])
    write_views(folder, photograph(Room(painted), poses, (64, 64)))
    return folder


@pytest.fixture
def shipped() -> EncodingOptions:
    """With trained weights, whose matching confirms the guides."""
    return EncodingOptions(effort="fast", num_stages=1)


def copied(folder: Path, target: Path, changed: str, content: bytes | None = None) -> Path:
    """Return a copy of a folder in which one file has another content, or half of its own: its header is whole."""
    copy, whole = Path(shutil.copytree(folder, target)), (folder / changed).read_bytes()
    (copy / changed).write_bytes(whole[: len(whole) // 2] if content is None else content)
    return copy


def test_the_others_guide_and_one_is_only_measured(seven, shipped, monkeypatch) -> None:
    module, sentence = "fecocodec.codec.encode_folder", "1.png is decoded far worse than the other views."
    monkeypatch.setattr(f"{module}.worst_view_warnings", lambda *_arguments, **_options: (sentence,))
    named = replace(shipped, views=(0, 1, 2))
    report = encode_folder(seven, named)
    assert sentence in report.warnings
    (check,) = report.checks.names
    assert sorted((*report.names, *report.guides.names, check)) == [f"{view}.png" for view in range(7)]
    every = fecocodec.read_views(seven)
    guides = every.select([every.names.index(name) for name in report.guides.names])
    assert report.data == fecocodec.encode(every.select([0, 1, 2]), guides=guides, effort="fast", num_stages=1)
    decoded = fecocodec.decode(report.data)
    seen = every.select([every.names.index(check)])
    rendered = fecocodec.render(decoded.gaussians, seen.cameras, seen.image_size).color.clamp(0, 1)
    expected = -10 * float((rendered - seen.images).square().mean().log10())
    assert report.checks.quality is not None and report.guides.quality is not None
    assert report.checks.quality.psnr == pytest.approx(expected, abs=1e-3)
    assert len(report.guides.quality.psnr_of_view) == 3


def test_what_is_only_measured_changes_nothing(seven: Path, options: EncodingOptions, tmp_path: Path) -> None:
    options = replace(options, views=Spread(2), num_stages=1)
    report = encode_folder(seven, options)
    (check,) = report.checks.names
    other = (seven / report.names[0]).read_bytes() + b" "  # a copy would be left out
    changed = encode_folder(copied(seven, tmp_path / "scene", check, other), options)
    assert changed.data == report.data and changed.checks.names == (check,)
    assert changed.checks.quality != report.checks.quality


def test_without_guides_and_checks_the_bytes_are_those_of_the_views(seven: Path, options: EncodingOptions) -> None:
    plain = replace(options, guides=(), num_checks=0, num_stages=1, is_measured=False)
    named = encode_folder(seven, replace(plain, views=(0, 1)))
    views = fecocodec.read_views(seven, views=(0, 1))
    assert named.data == fecocodec.encode(views, effort="fast", model=options.model, num_stages=1)
    assert named.guides == named.checks == OtherViews()
    assert len(encode_folder(seven, replace(plain, views=All())).names) == 7


@pytest.mark.usefixtures("uncoded")
def test_a_broken_guide_is_left_out_unless_it_is_named(seven: Path, shipped: EncodingOptions, tmp_path: Path) -> None:
    named = replace(shipped, views=(0, 1), num_checks=0, is_measured=False)
    broken = copied(seven, tmp_path / "scene", "3.png")
    report = encode_folder(broken, named)
    sentence = "3.png is left out: the image is damaged, cut short or"
    assert report.guides.names == ("2.png", "4.png", "5.png", "6.png")
    assert any(warning.startswith(sentence) for warning in report.warnings)
    with pytest.raises(BitstreamError, match="the file ends after 0 bytes"):  # the fixture's file: the guide was a note
        encode_folder(broken, replace(named, is_strict=True))
    assert len(encode_folder(broken, replace(named, guides=Spread(5))).guides.names) == 4  # a count names none
    assert len(encode_folder(seven, replace(named, guides=Spread(2))).guides.names) == 2
    with pytest.raises(InputError, match=rf"^{broken / '3.png'}"):
        encode_folder(broken, replace(named, guides=(2, 3)))


@pytest.mark.usefixtures("uncoded")
def test_another_photograph_takes_the_place_of_a_broken_one(seven, shipped, tmp_path) -> None:
    options = replace(shipped, views=Spread(2), num_checks=0, is_measured=False)
    first, second = encode_folder(seven, options).names
    broken = copied(seven, tmp_path / "scene", second)
    report = encode_folder(broken, options)
    assert len(report.names) == 2 and second not in (*report.names, *report.guides.names)
    (warning,) = (warning for warning in report.warnings if second in warning)
    assert warning.startswith(f"{second} is left out: the image is damaged, cut short or")
    notes: list[str] = []
    with suppress(StrictError, BitstreamError):  # of another warning, or as there is nothing to measure
        encode_folder(broken, replace(options, is_strict=True), on_note=notes.append)
    assert warning in notes
    with pytest.raises(InputError, match=rf"^{broken / second}: the image is damaged"):
        encode_folder(broken, replace(options, views=(first, second)))


@pytest.mark.usefixtures("uncoded")
@pytest.mark.parametrize("views", [None, All()])
def test_a_broken_photograph_among_few_is_left_out_unless_it_is_named(folder, options, tmp_path, views) -> None:
    options = replace(options, views=views, guides=None if views is None else (), num_stages=1, is_measured=False)
    for number, data in enumerate((b"", b"version https://git-lfs.github.com/spec/v1", None)):
        broken = copied(folder, tmp_path / str(number), "1.png", data)
        report = encode_folder(broken, options)
        assert report.names == ("0.png",)
        (warning,) = (sentence for sentence in report.warnings if "1.png" in sentence)
        assert warning.startswith("1.png is left out: the image is damaged, cut short or")
        with pytest.raises(InputError, match=rf"^{broken / '1.png'}: the image is damaged"):
            encode_folder(broken, replace(options, views=(0, 1)))
        (broken / "0.png").write_bytes((broken / "1.png").read_bytes() + b" ")
        with pytest.raises(InputError, match=rf"^{broken / '0.png'}: the image is damaged"):
            encode_folder(broken, options)


@pytest.mark.usefixtures("uncoded")
def test_what_was_read_is_said_before_how_many_are_coded(seven: Path, shipped: EncodingOptions, tmp_path: Path) -> None:
    cameras = json.loads((seven / "transforms.json").read_text())
    cameras["frames"].append({**cameras["frames"][0], "file_path": "absent.png"})
    folder = copied(seven, tmp_path / "scene", "transforms.json", json.dumps(cameras).encode())
    said: list[str] = []
    options = replace(shipped, is_measured=False)
    encode_folder(folder, options, on_note=said.append, on_warning=said.append)
    (missing,) = (place for place, sentence in enumerate(said) if "absent.png" in sentence)
    (counted,) = (place for place, sentence in enumerate(said) if " photographs are coded; " in sentence)
    assert missing < counted


@pytest.mark.usefixtures("uncoded")
def test_another_check_takes_the_place_of_a_broken_one(seven: Path, shipped: EncodingOptions, tmp_path: Path) -> None:
    options = replace(shipped, views=Spread(2), num_stages=1, is_measured=False)
    (check,) = encode_folder(seven, options).checks.names
    report = encode_folder(copied(seven, tmp_path / "scene", check), options)
    assert len(report.checks.names) == 1 and check not in (*report.checks.names, *report.guides.names)
    (warning,) = (warning for warning in report.warnings if check in warning)
    assert warning.startswith(f"{check} is left out: the image is damaged, cut short or")


@pytest.mark.usefixtures("uncoded")
def test_opaque_guides_do_not_teach_cut_outs(seven: Path, shipped: EncodingOptions, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(seven, tmp_path / "scene"))
    for name in ("0.png", "1.png", "2.png"):
        image = Image.open(folder / name).convert("RGBA")
        alpha = Image.new("L", image.size, 255)
        alpha.paste(0, (0, 0, 20, 64))
        image.putalpha(alpha)
        image.save(folder / name)
    cut_out = replace(shipped, views=(0, 1), num_checks=0, is_measured=False)
    report = encode_folder(folder, cut_out)
    assert report.guides.names == ("2.png",)
    (sentence,) = (warning for warning in report.warnings if warning.startswith("left out"))
    assert sentence.startswith("left out 3.png, 4.png, 5.png, 6.png, opaque, while the coded photographs are cut out;")
    assert encode_folder(folder, replace(cut_out, views=(3, 4))).guides.names == ("5.png", "6.png")
    with pytest.raises(InputError, match=f"^{folder}: left out 3.png, opaque"):
        encode_folder(folder, replace(cut_out, guides=(2, 3)))


def test_warnings_rest_on_new_views(seven: Path, options: EncodingOptions) -> None:
    options = replace(options, views=(0, 1), num_stages=1)
    warnings = encode_folder(seven, options).warnings
    (poor,) = (warning for warning in warnings if warning.startswith("new views are poor, with a PSNR of "))
    assert "leave out `effort=fast`" in poor and ", code more of them by `views`, or" in poor  # some guide
    assert not any(warning.startswith("the decoded views are poor") for warning in warnings)
    unchecked = encode_folder(seven, replace(options, num_checks=0)).warnings
    assert any(warning.startswith("the decoded views are poor") for warning in unchecked)


def test_fewer_are_coded_where_all_that_are_needed_do_not_fit(seven, shipped, tmp_path, monkeypatch) -> None:
    counts: list[int] = []

    def to_target(views: Views, **_options: object) -> bytes:
        counts.append(len(views.names))
        if len(views.names) > 2:
            raise SizeError("it is too large.", 20.0)
        return b""

    monkeypatch.setattr("fecocodec.codec.encode_views.encode_to_target", to_target)
    monkeypatch.setattr("fecocodec.codec.view_count.best_count", lambda shares: len(shares))
    options = replace(shipped, target=AtMostKib(8.0), num_stages=2, is_measured=False)
    report = encode_folder(seven, options)
    assert counts == [6, 2] == [6, len(report.names)]
    assert "6 coded photographs take 20.0 KiB or more; at most 2 are coded." in report.notes
    with pytest.raises(SizeError, match=f"^{seven}: it is too large"):
        encode_folder(seven, replace(options, views=Spread(4)))
    few = copied(seven, tmp_path / "few", "0.png", b"")
    for name in ("0.png", "1.png", "2.png"):
        (few / name).unlink()
    with pytest.raises(SizeError):  # all of four are coded
        encode_folder(few, options)


def test_messages_of_a_video_are_about_frames() -> None:
    video, sentence = Path("photograph 1/clip.mp4"), "photograph 1/clip.mp4: one photograph of 3 photographs."
    assert of_input(video, sentence) == "photograph 1/clip.mp4: one frame of 3 frames."
    assert of_input(Path("photos"), sentence) == sentence


def test_numbers_of_photographs_count_those_without_an_estimated_camera():
    """Else `--views 3` would code the photograph after the one that is left out."""
    source = SceneSource(Path("posed"), has_camera={"a.jpg": True, "b.jpg": False, "c.jpg": True, "7": True})
    assert source.named((0, 2), "views") == ("a.jpg", "c.jpg")
    assert source.named(("c", "2", "7", "9"), "views") == ("c", "c.jpg", "7", "9")  # the rest is told where it is used
    assert source.named(None, "views") is None and source.named(Spread(2), "views") == Spread(2)
    for called in (1, "1", "b.jpg", "photos/b.jpg"):
        with pytest.raises(InputError, match=r"b\.jpg has no camera, see above; choose another photograph in `guides`"):
            source.named((called,), "guides")
    assert SceneSource(Path("given")).named((1, "x"), "views") == (1, "x")
