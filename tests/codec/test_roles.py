"""Which photographs of a folder are coded, which guide, and which are only measured."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fecocodec.camera_files.posed_photographs import PosedPhotograph, PosedPhotographs
from fecocodec.captures.view_selection import All, Auto, Selection, Spread
from fecocodec.codec import roles as roles_of_photographs
from fecocodec.codec.guide_choice import MAX_GUIDES, OTHER_SHAPE
from fecocodec.codec.options import EncodingOptions
from fecocodec.codec.roles import Roles, default_checks
from fecocodec.errors import InputError
from fecocodec.photographs.lens import Lens

FOLDER = Path("photos")
MakeWalk = Callable[..., PosedPhotographs]


def choose_roles(scene, folder, views=None, guides=None, num_checks=None, size=None, decide=lambda order, _: order[:3]):
    options = EncodingOptions(views=views, guides=guides, num_checks=num_checks, size=size)
    return roles_of_photographs.choose_roles(scene, folder, options, decide)


@pytest.fixture
def walk(tmp_path: Path) -> MakeWalk:
    """A function that makes a street of `count` cameras side by side, `step` apart, with surfaces 2 to 10 away."""

    def make(count: int, step: float = 0.5, sizes: dict[int, tuple[int, int]] | None = None) -> PosedPhotographs:
        photographs = []
        for number in range(count):
            height, width = (sizes or {}).get(number, (64, 96))
            path = tmp_path / f"{number:03d}.png"
            Image.new("RGB", (width, height), (number % 256, number // 256, 0)).save(path)
            pose = np.eye(4)
            pose[0, 3] = step * number
            lens = lambda w, h: Lens(w, h, float(w), float(w), w / 2, h / 2)  # noqa: E731
            photographs.append(PosedPhotograph(path, f"frame {number}", pose, lens))
        return PosedPhotographs(tmp_path, photographs, 2.0, 10.0)

    return make


def num_unused(roles: Roles) -> int:
    return sum(map(len, roles.unused.values()))


def every(roles: Roles) -> list[int]:
    return [*roles.context, *roles.guides, *roles.checks]


def test_checks_are_one_in_ten_and_spread_over_the_poses(walk: MakeWalk) -> None:
    counts = {1: 0, 5: 0, 6: 1, 19: 1, 20: 2, 60: 6, 80: 8, 500: 8}
    assert {count: default_checks(count) for count in counts} == counts
    roles = choose_roles(walk(20, step=0.2), FOLDER, None)
    assert len(roles.checks) == 2
    assert len(set(every(roles))) == len(every(roles)) == 20 - num_unused(roles)
    checks = choose_roles(walk(24, step=0.5), FOLDER, None, num_checks=3).checks
    assert np.diff(checks).min() >= 4
    with pytest.raises(InputError, match="photos: 5 checks asked for, but 4 photographs can be left for them"):
        choose_roles(walk(8), FOLDER, Spread(4), num_checks=5)
    with pytest.raises(InputError, match="6 checks asked for, but 5 photographs"):
        choose_roles(walk(7), FOLDER, (0, 1), num_checks=6)
    with pytest.raises(InputError, match="1 check asked for, but no photograph can be left for it"):
        choose_roles(walk(2), FOLDER, num_checks=1)


def test_candidates_lie_far_apart_and_those_between_them_guide(walk: MakeWalk) -> None:
    seen = []

    def decide(order: list[int], others: list[int]) -> list[int]:
        seen.append((order, others))
        return order[:4]

    roles = choose_roles(walk(20, step=0.2), FOLDER, Auto(), decide=decide)
    ((order, others),) = seen
    assert len(order) == 16 and sorted(others) == [index for index in range(20) if index not in roles.checks]
    assert roles.context == sorted(order[:4]) and np.diff(roles.context).min() >= 3
    assert len(roles.guides) == 20 - 4 - len(roles.checks) - num_unused(roles)


def test_few_and_all_are_coded(walk: MakeWalk) -> None:
    assert choose_roles(walk(4), FOLDER, None) == Roles([0, 1, 2, 3], [], [])
    assert choose_roles(walk(16), FOLDER, All()) == Roles(list(range(16)), [], [])
    with pytest.raises(InputError, match="17 views chosen, but 1 to 16 can be used"):
        choose_roles(walk(17), FOLDER, All())
    roles = choose_roles(walk(20), FOLDER, Spread(4))
    assert len(roles.context) == 4 and roles.context[0] < 6 and roles.context[-1] > 14
    assert choose_roles(walk(6), FOLDER, Spread(6)) == Roles([0, 1, 2, 3, 4, 5], [], [])  # none is left to measure
    with pytest.raises(InputError, match="photos: 7 views asked for, but the folder has 6; choose 1 to 6"):
        choose_roles(walk(6), FOLDER, Spread(7))


def test_without_guides_and_checks_views_are_chosen_as_before(walk: MakeWalk) -> None:
    assert choose_roles(walk(4), FOLDER, None, (), 0).context == list(range(4))
    orders = []
    choose_roles(walk(20, step=0.2), FOLDER, None, (), decide=lambda order, _others: orders.append(order) or order)
    neighbours = np.abs(np.subtract.outer(orders[0], orders[0])) + 100 * np.eye(16)
    assert all(neighbours[place, :place].min() <= 6 for place in range(1, 16))  # each overlaps with one before it
    chosen = choose_roles(walk(20), FOLDER, Spread(8), (), 0)
    assert len(chosen.context) == 8 and num_unused(chosen) == 12 and every(chosen) == chosen.context


def test_those_near_named_views_guide(walk: MakeWalk) -> None:
    roles = choose_roles(walk(30), FOLDER, ("010", "12"))
    assert roles.context == [10, 12]
    assert {9, 11, 13} <= {*roles.guides, *roles.checks}
    assert all(abs(index - 11) < 12 for index in every(roles))
    assert num_unused(roles) == 30 - len(every(roles)) > 8
    assert len(choose_roles(walk(40, step=0.08), FOLDER, (0, 20)).guides) == MAX_GUIDES
    scene = walk(5, step=0.3)
    twin = replace(scene.photographs[2], camera_to_world=scene.photographs[0].camera_to_world)
    scene.photographs[2] = twin
    assert choose_roles(scene, FOLDER, (0, 4)).guides == [1, 3]


def test_named_guides_guide_alone(walk: MakeWalk) -> None:
    roles = choose_roles(walk(8), FOLDER, (0, 3), ("001.png", "2"), 0)
    assert roles == Roles([0, 3], [1, 2], [], {"not named in `guides`": [4, 5, 6, 7]})
    assert 1 not in choose_roles(walk(8), FOLDER, None, (1,)).context
    with pytest.raises(InputError, match=r"photos: no view is called x \(.*\); give .* in `guides`"):
        choose_roles(walk(8), FOLDER, (0, 3), ("x",))
    with pytest.raises(InputError, match=r"photos: 003.png is to be coded and to guide; name it in `views` or"):
        choose_roles(walk(8), FOLDER, (0, 3), (3,))
    with pytest.raises(InputError, match="no photograph is left to be coded"):
        choose_roles(walk(6), FOLDER, None, (0, 1, 2, 3, 4, 5))


def test_so_many_guide_at_most(walk: MakeWalk) -> None:
    scene = walk(40, step=0.08)
    named = lambda guides: choose_roles(scene, FOLDER, (0, 20), guides, 2)  # noqa: E731
    chosen, few = named(None).guides, named(Spread(3)).guides
    assert len(few) == 3 and set(few) < set(chosen) and named(Spread(MAX_GUIDES)).guides == chosen
    assert len(named(Spread(30)).guides) == 30  # the bound is the user's
    assert named(Spread(0)) == named(())
    assert choose_roles(walk(4), FOLDER, None, Spread(2)) == choose_roles(walk(4), FOLDER, None)
    assert len(choose_roles(walk(20, step=0.2), FOLDER, None, Spread(4)).guides) == 4


def test_each_unused_photograph_has_its_reason(walk: MakeWalk) -> None:
    scene = walk(40, step=0.08)
    for index, offset in ((38, 0.0), (39, 1000.0)):
        pose = scene.photographs[0].camera_to_world.copy()
        pose[0, 3] += offset
        scene.photographs[index] = replace(scene.photographs[index], camera_to_world=pose)
    scene.photographs[37].path.write_bytes(scene.photographs[36].path.read_bytes())
    unused = choose_roles(scene, FOLDER, (0, 20), None, 0).unused
    assert unused.pop("too little overlap with the coded views") == [39]
    assert 38 in unused.pop("same position and view as a coded one")
    assert unused.pop("copy of another one") == [37]
    assert list(unused) == ["beyond 24 guides"]
    assert len(choose_roles(scene, FOLDER, (0, 20), Spread(5), 0).unused["beyond 5 guides"]) > 24
    assert choose_roles(walk(6), FOLDER, (0, 1), (), 0).unused == {"`guides` is none": [2, 3, 4, 5]}
    assert choose_roles(walk(6), FOLDER, (0, 1), (2,), 0).unused == {"not named in `guides`": [3, 4, 5]}


def test_what_cannot_be_used_is_left_out_unless_it_is_named(walk: MakeWalk) -> None:
    scene = walk(8)
    scene.photographs[3].path.write_bytes(b"no image")
    bent = scene.photographs[5].camera_to_world.copy()
    bent[0, 0] = 3.0
    scene.photographs[5] = replace(scene.photographs[5], camera_to_world=bent)
    roles = choose_roles(scene, FOLDER, None)
    assert not {3, 5} & set(every(roles))
    of_image, of_camera = roles.omissions
    assert of_image.startswith("003.png is left out: the image is damaged, cut short") and of_image.endswith(".")
    assert of_camera.startswith("005.png is left out: ") and "frame 5" not in of_camera
    assert choose_roles(scene, FOLDER, (0, 3), (1, 5), 0).context == [0, 3]  # reading them reports what is wrong


@pytest.mark.parametrize("views", [None, All(), Auto(), Spread(2)])
@pytest.mark.parametrize("count", [4, 12])
def test_copies_are_left_out_unless_they_are_named(walk: MakeWalk, count: int, views: Selection | None) -> None:
    scene = walk(count)
    scene.photographs[2].path.write_bytes(scene.photographs[1].path.read_bytes())
    roles = choose_roles(scene, FOLDER, views)
    assert 2 not in every(roles)
    assert roles.warnings == ("002.png is left out: it is a copy of 001.png; remove it, or choose both by `views`.",)
    named = choose_roles(scene, FOLDER, (0, 2), num_checks=0)
    assert 1 not in every(named) and named.warnings == ()
    assert len(every(named)) + num_unused(named) == count
    assert choose_roles(scene, FOLDER, (1, 2), num_checks=0).context == [1, 2]


def test_a_photograph_that_shows_something_else_has_no_role(walk: MakeWalk) -> None:
    scene = walk(8)
    away = scene.photographs[4].camera_to_world.copy()
    away[:3, 3] = 1000.0
    scene.photographs[4] = replace(scene.photographs[4], camera_to_world=away)
    roles = choose_roles(scene, FOLDER, None)
    assert 4 not in every(roles) and num_unused(roles) == 1


def test_photographs_of_another_shape_guide_but_set_no_size(walk: MakeWalk) -> None:
    scene = walk(9, step=0.2, sizes={0: (200, 60), 8: (200, 60)})
    roles = choose_roles(scene, FOLDER, None, num_checks=0)
    assert not {0, 8} & set(roles.context)
    assert {0, 8} <= set(roles.guides)
    apart = walk(9, step=1.2, sizes={8: (200, 60)})
    of_first = partial(choose_roles, apart, FOLDER, None, num_checks=0, decide=lambda order, _others: order[:1])
    assert of_first().unused[OTHER_SHAPE] == [8] and OTHER_SHAPE not in of_first(size=(64, 64)).unused


def test_checks_set_no_bounds_of_depth(walk: MakeWalk, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fecocodec.codec.roles.spread_over", lambda *_arguments: [4, 9])
    scene = replace(walk(12, step=0.3), near=None, far=None)
    roles = []
    for depths_of_checks in ((2.0, 10.0), (0.2, 900.0)):
        for index, photograph in enumerate(scene.photographs):
            bounds = depths_of_checks if index in (4, 9) else (2.0, 10.0)
            scene.photographs[index] = replace(photograph, sparse_depths=np.linspace(*bounds, 200))
        roles.append(choose_roles(scene, FOLDER, None))
    assert roles[0].context == roles[1].context and roles[0].guides == roles[1].guides


def test_numbers_count_all_frames_even_those_without_an_image(walk: MakeWalk) -> None:
    scene = walk(8, step=0.2)
    scene.photographs[1].path.unlink()
    roles = choose_roles(scene, FOLDER, None, guides=(5, "003"))
    assert roles.guides == [5, 3] and 1 not in every(roles)
    (warning,) = roles.warnings
    assert "1 of 8 images" in warning
    with pytest.raises(InputError, match=r"001\.png"):
        choose_roles(scene, FOLDER, None, guides=(1,))
