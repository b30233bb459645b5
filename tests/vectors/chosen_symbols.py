"""Streams with given symbols, in integer arithmetic, so that their bytes are the same on every machine."""

from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random

import numpy as np

from fecocodec.coding.detail import detail_size, encode_detail
from fecocodec.coding.payload import CodedLatents, code_latents
from fecocodec.coding.visibility import pack_levels
from fecocodec.container import COVERAGE_CELLS, FADING_BLOCKS, Detail, Header, PackedCameras, Stream
from fecocodec.container.metadata import Metadata
from fecocodec.entropy.symbol_coders import SymbolWriter
from fecocodec.entropy.tables import load_tables
from fecocodec.geometry.coding_grid import grid_size
from tests.container.example_streams import TURNED, float32, pose
from tests.vectors.symbols import detail_tables_of, prior_of
from tests.vectors.tiny_model import tiny_model_id

Choice = Callable[[Random, int], int]
"""(generator, table index) -> symbol."""

LENS = tuple(float32(value) for value in (0.9, 1.6, 0.5, 0.5))
LEVEL = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def usual(random: Random, table: int) -> int:
    """Choose symbols about as wide as the table, some of them beyond its reach."""
    reach = load_tables()[table].reach
    if random.random() < 0.002:
        return int(random.random() * 40 * reach) - 20 * reach
    return sum(int(random.random() * (2 * reach + 1)) - reach for _ in range(6)) // 6


def sparse(random: Random, table: int) -> int:
    """Choose zero for five of six symbols."""
    return usual(random, table) if random.random() < 1 / 6 else 0


def zero(random: Random, table: int) -> int:
    return 0


def lowest(random: Random, table: int) -> int:
    """Choose what an empty payload decodes to: the first entry of each table."""
    return -load_tables()[table].reach


def around_the_escape(random: Random, table: int) -> int:
    """Choose the last symbols within reach, the first beyond it, and the largest possible, of both signs."""
    reach = load_tables()[table].reach
    magnitudes = (reach - 1, reach, reach + 1, reach + 2, reach + 3, 2**19, 2**20 - 1, 2**20)
    magnitude = magnitudes[int(random.random() * len(magnitudes))]
    return -magnitude if random.random() < 0.5 else magnitude


def choose_each(choose: Choice, random: Random, table_index: np.ndarray) -> np.ndarray:
    """Return symbols for a batch of table indices, chosen one after the other."""
    symbols = [choose(random, table) for table in table_index.ravel().tolist()]
    return np.array(symbols, dtype=np.int32).reshape(table_index.shape)


class ChosenWriter(SymbolWriter):
    """Writes given symbols instead of quantised latents."""

    def __init__(self, choose: Choice, seed: int) -> None:
        super().__init__()
        self.choose, self.random = choose, Random(seed)

    def exchange(self, table_index: np.ndarray, wanted: np.ndarray | None) -> np.ndarray:
        return super().exchange(table_index, choose_each(self.choose, self.random, table_index))


def cameras_of(num_views: int, shares_lens: bool = True) -> PackedCameras:
    """Return cameras side by side, every other one rotated."""
    poses = tuple(
        pose(TURNED if view % 2 else LEVEL, (0.25 * view, -0.125 * view, 0.5 * view)) for view in range(num_views)
    )
    lenses = tuple(LENS if shares_lens else (LENS[0] + view / 64, *LENS[1:]) for view in range(num_views))
    return PackedCameras(poses, tuple(tuple(map(float32, lens)) for lens in lenses), 0.5, 100.0)


@dataclass(frozen=True)
class Recipe:
    """Parameters of a stream. covers: one covered cell in this many; None for no coverage section.

    fades: whether there is a fading section. detail_step: None for no detail section.
    model_id: None for the tiny model.
    """

    height: int = 72
    width: int = 70
    lambda_q: int = 1179
    cameras: PackedCameras = field(default_factory=lambda: cameras_of(2))
    num_stages: int = 2
    choose: Choice = usual
    covers: int | None = None
    fades: bool = False
    detail_step: int | None = None
    metadata: Metadata | None = None
    excess: int = 0
    seed: int = 1
    model_id: bytes | None = None


def stream_of_recipe(recipe: Recipe) -> Stream:
    """Return the stream of a recipe, with the digests of its symbols."""
    num_views, grid = recipe.cameras.num_views, grid_size(recipe.height, recipe.width)
    size = (num_views, grid[0] // 32, grid[1] // 32)
    model_id = recipe.model_id or tiny_model_id()
    payloads: list[bytes] = []
    coded: list[CodedLatents] = []
    for stage in range(1, recipe.num_stages + 1):
        writer = ChosenWriter(recipe.choose, 100 * recipe.seed + stage)
        context = coded[0].y_hat if coded else None
        lambda_q = recipe.lambda_q + (2 * recipe.excess if stage == 1 else 0)
        coded.append(code_latents(prior_of(model_id), writer, lambda_q, stage, context, size, None))
        payloads.append(writer.finish())
    header = Header(
        *(model_id, num_views, recipe.height, recipe.width, recipe.lambda_q),
        symbol_digests=tuple(latents.digest() for latents in coded),
        first_stage_excess=recipe.excess,
    )
    coverage = None if recipe.covers is None else cells_covered(header, recipe.covers)
    fading = levels_of(header) if recipe.fades else None
    detail = None if recipe.detail_step is None else Detail(recipe.detail_step, detail_of(header, recipe))
    return Stream(header, recipe.cameras, tuple(payloads), recipe.metadata, coverage, fading, detail)


def detail_of(header: Header, recipe: Recipe) -> bytes:
    """Return the payload of detail."""
    random = Random(100 * recipe.seed + 3)
    choose = lambda plane, table_index: choose_each(recipe.choose, random, table_index)  # noqa: E731
    tables = detail_tables_of(header.model_id)
    assert tables is not None
    return encode_detail(tables, choose, detail_size(header))[0]


def cells_covered(header: Header, every: int) -> bytes:
    """Return a bitmap that covers the first of each group of `every` cells; 0 covers none."""
    views, rows, columns = COVERAGE_CELLS.shape(header)
    bits = [every > 0 and cell % every == 0 for cell in range(views * rows * columns)]
    return np.packbits(np.array(bits, dtype=np.uint8)).tobytes()


def levels_of(header: Header) -> bytes:
    """Return levels of the fading section that go through 0 to 3 in an order that repeats after 17 blocks."""
    views, rows, columns = FADING_BLOCKS.shape(header)
    levels = [(block % 17) * 5 % 7 % 4 for block in range(views * rows * columns)]
    return pack_levels(np.array(levels, dtype=np.uint8).reshape(views, rows, columns))
