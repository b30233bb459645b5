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
