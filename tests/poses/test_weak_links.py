"""Parts of an estimate that few matches join, most others of which contradict: made-up cameras and matches."""

import numpy as np
import pytest

from fecocodec.photographs.lens import Lens
from fecocodec.poses.estimate_choice import cut_weak_links, joined_names, least_explained
from tests.poses.made_up_cameras import camera, pixels

LENS = Lens(640, 480, 500.0, 500.0, 320.0, 240.0)
NAMES = "abcdef"


CAMERAS = tuple(camera(name, LENS, (0.3 * index, 0, 0)) for index, name in enumerate(NAMES))


def matches_of(fitting: dict[str, int], contradicting: dict[str, int]) -> dict:
    """Return matches of pairs of photographs, such as `ab`, that fit the cameras, and others that do not."""
    generator, points = np.random.default_rng(0), {}
    for pair in fitting | contradicting:
        world = generator.uniform((-1, -1, 5), (2, 1, 9), (fitting.get(pair, 0) + contradicting.get(pair, 0), 3))
        seen = [pixels(CAMERAS[NAMES.index(name)], world) for name in pair]
        seen[1][fitting.get(pair, 0) :, 1] += 40.0  # across the epipolar lines, which are rows
        points[pair[0], pair[1]] = seen[0], seen[1]
    return points


CHAIN = {"ab": 200, "bc": 150, "de": 200, "ef": 120}


@pytest.mark.parametrize(
    ("fitting", "contradicting", "kept"),
    [
        (CHAIN | {"cd": 20}, {}, "abcdef"),  # few matches, of which none contradicts
        (CHAIN | {"cd": 70}, {"cd": 90}, "abcdef"),  # a link that is strong enough by itself
        ({"ab": 200, "bc": 150, "cd": 150, "de": 40, "ef": 120}, {"de": 60}, "abcd"),
        (CHAIN | {"cd": 20, "ae": 10}, {"bd": 9}, "abcdef"),
        ({"ab": 200, "bc": 150, "ac": 90, "cd": 90, "de": 90, "ef": 20}, {"df": 18}, "abcde"),
        # A wrong photograph brings its true neighbours with it, which agree with each other.
        ({"ab": 200, "bc": 150, "cd": 120, "de": 20, "ef": 300}, {"ce": 15, "df": 15}, "abcd"),
        (CHAIN | {"ac": 90, "ef": 0}, {"cd": 80, "df": 40}, "abc"),
    ],
)
def test_parts_that_few_matches_join_and_others_contradict_are_cut_off(fitting, contradicting, kept: str):
    points = matches_of(fitting, contradicting)
    assert joined_names(CAMERAS, points) == frozenset(kept)


def test_the_least_explained_part_is_measured_also_where_nothing_is_cut():
    assert least_explained(CAMERAS, matches_of(CHAIN | {"cd": 40}, {"cd": 60})) == pytest.approx(0.4)
    assert least_explained(CAMERAS, matches_of(CHAIN | {"cd": 90}, {})) == 1.0
    assert least_explained(CAMERAS[:1], {}) == 1.0
    assert joined_names(CAMERAS[:2], matches_of({"ab": 20}, {"ab": 80})) == {"a", "b"}


def test_photographs_that_are_cut_off_lose_their_cameras(monkeypatch):
    class Model:
        def __init__(self) -> None:
            self.registered = dict(enumerate(NAMES))

        def reg_image_ids(self) -> list[int]:
            return list(self.registered)

        def image(self, number: int):
            return type("Image", (), {"name": self.registered[number], "frame_id": number})()

        def deregister_frame(self, number: int) -> None:
            del self.registered[number]

    monkeypatch.setattr("fecocodec.poses.estimate_choice.cameras_of", lambda model: CAMERAS)
    model = Model()
    assert not cut_weak_links(model, matches_of(CHAIN | {"cd": 90}, {}))
    assert model.registered == dict(enumerate(NAMES))
    assert cut_weak_links(model, matches_of({"ab": 200, "bc": 150, "cd": 90, "de": 90, "ef": 20}, {"df": 18}))
    assert model.registered == dict(enumerate("abcde"))
