"""Which cells count as covered, from the opacity of the views as given."""

import torch

from fecocodec.sender.coverage import covered_cells


def test_a_cell_is_covered_by_one_opaque_pixel() -> None:
    alpha = torch.zeros(2, 64, 64)
    alpha[1, 11, 20] = 0.5
    cells = covered_cells(alpha, (2, 16, 16))
    assert cells.nonzero().tolist() == [[1, 2, 5]]
    assert not covered_cells(0.99 * alpha, (2, 16, 16)).any()


def test_cells_cover_the_image_where_the_coding_grid_has_another_size() -> None:
    """70 rows on a grid of 64: cell 0 spans rows 0 to 4.375, cell 15 spans rows 65.625 to 70."""
    alpha = torch.zeros(1, 70, 64)
    alpha[0, 4, 0], alpha[0, 69, 63] = 1.0, 1.0
    assert covered_cells(alpha, (1, 16, 16)).nonzero().tolist() == [[0, 0, 0], [0, 1, 0], [0, 15, 15]]


def test_cells_across_a_silhouette_are_left_out_beside_cells_within_the_part() -> None:
    alpha = torch.zeros(1, 64, 64)
    alpha[:, :, :10] = 1.0  # half of the third column of cells
    assert covered_cells(alpha, (1, 16, 16))[0, 0].nonzero().flatten().tolist() == [0, 1]
    alpha[:, :, 10], alpha[:, :, 11] = 1.0, 0.3  # 82% of it
    assert covered_cells(alpha, (1, 16, 16))[0, 0].nonzero().flatten().tolist() == [0, 1, 2]


def test_all_cells_of_a_part_that_has_none_within_are_covered() -> None:
    alpha = torch.zeros(1, 64, 64)
    alpha[:, :, 6:9] = 1.0  # thinner than a cell, in two columns of cells
    assert covered_cells(alpha, (1, 16, 16))[0, 0].nonzero().flatten().tolist() == [1, 2]
