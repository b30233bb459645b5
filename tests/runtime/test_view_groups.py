"""Groups of views: every view once, in order, and as many at a time as their maps allow."""

import pytest

from fecocodec.runtime.view_groups import CELLS_AT_ONCE, groups_of_views


@pytest.mark.parametrize(("grid", "sizes"), [((2, 64, 64), [2]), ((7, 64, 64), [4, 3]), ((3, 256, 256), [1, 1, 1])])
def test_groups_visit_every_view_once(grid: tuple[int, int, int], sizes: list[int]) -> None:
    views = list(range(grid[0]))
    groups = [views[group] for group in groups_of_views(*grid)]
    assert [view for group in groups for view in group] == views
    assert [len(group) for group in groups] == sizes
    assert all(len(group) == 1 or len(group) * grid[1] * grid[2] <= CELLS_AT_ONCE for group in groups)
