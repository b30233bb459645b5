"""Groups of views: every view once, in order, and as many at a time as their maps allow."""

import pytest

from fecocodec.runtime.view_groups import CELLS_AT_ONCE, groups_of_views


@pytest.mark.parametrize(
    ("grid", "num_threads", "sizes"),
    [
        ((2, 64, 64), 2, [1, 1]),
        ((7, 64, 64), 2, [4, 3]),
        ((7, 64, 64), 1, [7]),
        ((16, 128, 128), 2, [1] * 16),
        ((1, 64, 64), 2, [1]),
        ((3, 64, 64), 16, [3]),
        ((3, 256, 256), 2, [1, 1, 1]),
    ],
)
def test_groups_visit_every_view_once(grid: tuple[int, int, int], num_threads: int, sizes: list[int]) -> None:
    views = list(range(grid[0]))
    slices, is_parallel = groups_of_views(grid, num_threads)
    groups = [views[group] for group in slices]
    assert [view for group in groups for view in group] == views
    assert [len(group) for group in groups] == sizes
    at_once = num_threads if is_parallel else 1
    cells = grid[1] * grid[2]
    assert all(
        (len(group) == 1 and not is_parallel) or len(group) * at_once * cells <= CELLS_AT_ONCE for group in groups
    )
