"""Second decoder of symbols, written from ENTROPY.md alone: payloads and a weights file -> z_hat, y_hat and detail.

It uses Python integers and only the standard library, and is slow (a few milliseconds per position of y). Section
numbers in docstrings are those of ENTROPY.md, whose order the code follows.
"""

import hashlib
import json
from collections.abc import Callable
from itertools import accumulate
from operator import mul
from pathlib import Path
from typing import Any, NamedTuple

TABLES = Path(__file__).resolve().parent.parent / "fecocodec" / "entropy" / "symbol_tables.bin"
TABLES_SHA256 = "b48cf11ed8025fa24296cda054e9917eb96d004be7d83b91395714867feb34c2"
LOWEST, HIGHEST = -32768, 32767
LANE = 2**48
HALF_LANE = LANE // 2

Vector = list[int]
Array = list[list[list[Vector]]]  # x[view][row][column][channel]
Size = tuple[int, int, int]
Offsets = list[tuple[int, int]]
THRESHOLDS = (1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 96, 140)
KNOWN: list[Offsets] = [[], [(-1, -1), (-1, 1), (1, -1), (1, 1)], [(-1, 0), (0, -1), (0, 1), (1, 0)]]


class RefusedError(Exception):
    """A payload or a weights file breaks a rule of ENTROPY.md."""


class Table(NamedTuple):
    """Section 4. starts[k] = f[0] + ... + f[k-1]."""

    reach: int
    frequencies: list[int]
    starts: list[int]


class Layer(NamedTuple):
    """Section 5. rows[g][k] is the sum over o of weight[g, k, o] * LANE^o; biases[g] likewise.

    One product of long integers computes the products of all outputs, which is several times as fast.
    """

    rows: list[list[int]]
    biases: list[int]
    outputs: int


class Stage(NamedTuple):
    """Content of a payload: symbols of the seven batches, dequantised values in Q8, digest (section 8)."""

    batches: list[list[int]]
    z_hat: Array
    y_hat: Array
    digest: bytes


class Model(NamedTuple):
    """Section 6. L, Z: channels of y and z. is_apart: whether y_hat of stage 1 counts as zero in stage 2."""

    layers: dict[str, Layer]
    L: int
    Z: int
    tables: list[Table]
    is_apart: bool


def require(condition: bool, sentence: str) -> None:
    if not condition:
        raise RefusedError(sentence)


def read_tables(data: bytes) -> list[Table]:
    """Section 4."""
    require(hashlib.sha256(data).hexdigest() == TABLES_SHA256, "the tables are not those of the format")
    tables, at = [], 0
    for _ in range(64):
        reach = int.from_bytes(data[at : at + 2], "little")
        count = 2 * reach + 2
        f = [int.from_bytes(data[at + 2 + 4 * k : at + 6 + 4 * k], "little") for k in range(count)]
        tables.append(Table(reach, f, [0, *accumulate(f)][:-1]))
        at += 2 + 4 * count
    return tables


def read_weights_file(data: bytes) -> tuple[dict[str, Any], bytes]:
    """Section 6.1: header and data."""
    header_size = int.from_bytes(data[:8], "little")
    require(8 + header_size <= len(data), "the weights file ends within its header")
    try:
        header = json.loads(data[8 : 8 + header_size])
    except ValueError as error:
        raise RefusedError(f"the header of the weights file is no JSON ({error})") from error
    return header, data[8 + header_size :]


def read_detail_tables(data: bytes) -> list[list[int]]:
    """Section 6.1: detail.tables[k][bucket]."""
    header, body = read_weights_file(data)
    require("detail.tables" in header, "the model has no detail")
    values, shape = read_integers(header["detail.tables"], body, "U8", 63)
    require(len(shape) == 2 and shape[1] == 16, "the tables of detail are not 16 for each plane")
    return [values[at : at + 16] for at in range(0, len(values), 16)]


def read_model(data: bytes) -> Model:
    """Section 6.2, the layers of the weights file."""
    header, body = read_weights_file(data)
    names = {name.removeprefix("prior.").rpartition(".")[0] for name in header if name.startswith("prior.")}
    layers = {name: read_layer(header, body, f"prior.{name}") for name in sorted(names)}
    require({"hyper_prior", "enter", "up_16", "around_16", "up_8", "merge_8"} <= names, "a layer is missing")
    for s in ("passes.0", "passes.1", "passes.2", "steps.1", "steps.2", "steps.3"):
        require({f"{s}.{part}" for part in ("enter", "middle", "leave")} <= names, "a layer is missing")
    num_y, num_z = 2 * layers["steps.1.leave"].outputs, layers["hyper_prior"].outputs // 2
    config = json.loads(header.get("__metadata__", {}).get("config", "{}"))
    is_apart = config.get("receiver", {}).get("codes_stages_apart", False)
    return Model(layers, num_y, num_z, read_tables(TABLES.read_bytes()), is_apart)


def read_layer(header: dict[str, Any], body: bytes, name: str) -> Layer:
    weight, shape = read_integers(header[f"{name}.weight"], body, "I16", 32767)
    bias, _ = read_integers(header[f"{name}.bias"], body, "I32", 2**24)
    groups, inputs, outputs = shape
    rows = [side_by_side(weight[at : at + outputs]) for at in range(0, len(weight), outputs)]
    biases = [side_by_side(bias[g * outputs : (g + 1) * outputs]) for g in range(groups)]
    return Layer([rows[g * inputs : (g + 1) * inputs] for g in range(groups)], biases, outputs)


def side_by_side(values: list[int]) -> int:
    return sum(value * LANE**o for o, value in enumerate(values))


def read_integers(entry: dict[str, Any], body: bytes, kind: str, largest: int) -> tuple[list[int], list[int]]:
    begin, end = entry["data_offsets"]
    size = {"U8": 1, "I16": 2, "I32": 4}[kind]
    count = 1
    for side in entry["shape"]:
        count *= side
    require(entry["dtype"] == kind and end - begin == size * count and end <= len(body), "a tensor has a wrong form")
    signed = kind != "U8"
    values = [int.from_bytes(body[at : at + size], "little", signed=signed) for at in range(begin, end, size)]
    require(max(map(abs, values)) <= largest, "a weight is out of range")
    return values, entry["shape"]


class Coder:
    """Section 2."""

    def __init__(self, payload: bytes) -> None:
        require(len(payload) % 4 == 0 and payload[-4:] != bytes(4), "the payload is no list of words")
        self.words = [int.from_bytes(payload[at : at + 4], "little") for at in range(0, len(payload), 4)]
        self.state = 0
        self.refill()
        self.refill()

    def refill(self) -> None:
        if self.state < 2**32 and self.words:
            self.state = self.state * 2**32 + self.words.pop()

    def take(self, table: Table) -> int:
        slot = self.state % 2**24
        low, high = 0, len(table.starts)  # starts[low] <= slot < starts[high]
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if table.starts[middle] <= slot else (low, middle)
        self.state = (self.state >> 24) * table.frequencies[low] + slot - table.starts[low]
        self.refill()
        return low

    def take_bits(self, n: int) -> int:
        slot, frequency = self.state % 2**24, 2 ** (24 - n)
        self.state = (self.state >> 24) * frequency + slot % frequency
        self.refill()
        return slot // frequency


def take_batch(coder: Coder, tables: list[Table], indices: list[int]) -> list[int]:
    """Section 3."""
    symbols = [0] * len(indices)
    order = sorted((element for element, index in enumerate(indices) if index >= 6), key=lambda e: (indices[e], e))
    escaped = []
    for element in order:
        table = tables[indices[element]]
        entry = coder.take(table)
        symbols[element] = entry - table.reach
        if entry == 2 * table.reach + 1:
            escaped.append(element)
    exponents = [coder.take_bits(5) for _ in escaped]
    require(max(exponents, default=0) <= 19, "an escape has an exponent above 19")
    for element, exponent in zip(escaped, exponents, strict=True):
        mantissa = coder.take_bits(exponent + 1)
        magnitude = tables[indices[element]].reach + 2**exponent + (mantissa >> 1)
        require(magnitude <= 2**20, "a symbol is above 2^20 in magnitude")
        symbols[element] = -magnitude if mantissa % 2 else magnitude
    return symbols


def clip(value: int, low: int = LOWEST, high: int = HIGHEST) -> int:
    return min(max(value, low), high)


def apply(layer: Layer, x: Vector, group: int = 0) -> Vector:
    """Section 5. `map` ends with the shorter list, so that missing inputs count as 0."""
    sums = layer.biases[group] + sum(map(mul, x, layer.rows[group]))
    # Sums are below 2^40 in magnitude; adding half a lane to each makes them non-negative digits of base LANE.
    digits = (sums + HALF_LANE * ((LANE**layer.outputs - 1) // (LANE - 1))).to_bytes(6 * layer.outputs, "little")
    found = (int.from_bytes(digits[at : at + 6], "little") - HALF_LANE for at in range(0, len(digits), 6))
    return [clip((value + 2**11) >> 12) for value in found]


def relu(x: Vector) -> Vector:
    return [max(value, 0) for value in x]


def around(x: Array, v: int, i: int, j: int) -> Vector:
    return beside(x, v, i, j, [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)])


def beside(x: Array, v: int, i: int, j: int, offsets: Offsets) -> Vector:
    rows, columns, nothing = len(x[v]), len(x[v][0]), [0] * len(x[v][0][0])
    found: Vector = []
    for a, b in offsets:
        found += map(clip, x[v][i + a][j + b]) if 0 <= i + a < rows and 0 <= j + b < columns else nothing
    return found


def double(x: Array) -> Array:
    quarter = len(x[0][0][0]) // 4
    return [
        [
            [
                view[i // 2][j // 2][(2 * (i % 2) + j % 2) * quarter :][:quarter]
                for j in range(2 * len(view[0]))
            ]
            for i in range(2 * len(view))
        ]
        for view in x
    ]  # fmt: skip


def array(size: Size, vector: Callable[[int, int, int], Vector]) -> Array:
    return [[[vector(v, i, j) for j in range(size[2])] for i in range(size[1])] for v in range(size[0])]


def table_index(position: int) -> int:
    return clip(22 + ((position + 16) >> 5), 0, 63)


def decode_stage(model: Model, payload: bytes, size_8: Size, lambda_q: int, stage: int, before: Array | None) -> Stage:
    """Section 7.1. size_8: N, H8, W8. before: y_hat of stage 1 in stage 2, None in stage 1."""
    coder, layers = Coder(payload), model.layers
    condition = [0, 0, 0, 0]
    condition[stage - 1], condition[stage + 1] = 256, lambda_q - 884
    views, height, width = size_8
    size_32 = (views, height // 4, width // 4)
    z_symbols, z_hat = read_z(coder, model, size_32, condition)
    a = array(size_32, lambda v, i, j: relu(apply(layers["enter"], around(z_hat, v, i, j) + condition)))
    b = double([[[relu(apply(layers["up_16"], x)) for x in row] for row in view] for view in a])
    size_16 = (views, height // 2, width // 2)
    c = array(size_16, lambda v, i, j: relu(apply(layers["around_16"], around(b, v, i, j))))
    d = double([[[relu(apply(layers["up_8"], x)) for x in row] for row in view] for view in c])

    def merge(v: int, i: int, j: int) -> Vector:
        seen = around(before, v, i, j) if before is not None else []
        seen = [0] * len(seen) if model.is_apart else seen
        return relu(apply(layers["merge_8"], d[v][i][j] + condition + seen))

    y_symbols, y_hat = read_y(coder, model, array(size_8, merge))
    require(coder.state == 0 and not coder.words, "symbols and bytes do not end together")
    batches = [z_symbols, *y_symbols]
    return Stage(batches, z_hat, y_hat, digest(batches))


def read_z(coder: Coder, model: Model, size: Size, condition: Vector) -> tuple[list[int], Array]:
    """Section 7.1, step 2."""
    parameters, channels = apply(model.layers["hyper_prior"], condition), model.Z
    means, indices = parameters[:channels], [table_index(p) for p in parameters[channels:]]
    symbols = take_batch(coder, model.tables, indices * (size[0] * size[1] * size[2]))

    def values(v: int, i: int, j: int) -> Vector:
        first = ((v * size[1] + i) * size[2] + j) * channels
        return [256 * symbols[first + c] + means[c] for c in range(channels)]

    return symbols, array(size, values)


def read_y(coder: Coder, model: Model, e: Array) -> tuple[list[list[int]], Array]:
    """Section 7.1, step 4."""
    size, quarter = (len(e), len(e[0]), len(e[0][0])), model.L // 4
    batches, first = read_step_0(coder, model, e)
    steps = [first]
    for s in (1, 2, 3):
        means: list[int] = []
        indices: list[int] = []
        for m, v, i, j in phase_by_phase(size):
            x = e[v][i][j] + [value for k in steps for value in around(k, v, i, j)]
            parameters = three_layers(model, f"steps.{s}", x, m)
            means += parameters[:quarter]
            indices += map(table_index, parameters[quarter:])
        batches.append(take_batch(coder, model.tables, indices))
        values = [256 * symbol + mean for symbol, mean in zip(batches[-1], means, strict=True)]
        k = array(size, lambda *_: [0] * quarter)
        for at, (_, v, i, j) in enumerate(phase_by_phase(size)):
            k[v][i][j] = values[at * quarter :][:quarter]
        steps.append(k)
    y_hat = array(size, lambda *_: [0] * model.L)
    for x_s, k in zip((0, 3, 2, 1), steps, strict=True):
        for m, v, i, j in phase_by_phase(size):
            q = m ^ x_s
            y_hat[v][i][j][quarter * q : quarter * q + quarter] = k[v][i][j]
    return batches, y_hat


def read_step_0(coder: Coder, model: Model, e: Array) -> tuple[list[list[int]], Array]:
    size, quarter = (len(e), len(e[0]), len(e[0][0])), model.L // 4
    size_16 = (size[0], size[1] // 2, size[2] // 2)

    def summed(v: int, i: int, j: int) -> Vector:
        block = (e[v][2 * i + a][2 * j + b] for a in (0, 1) for b in (0, 1))
        return [clip(sum(values)) for values in zip(*block, strict=True)]

    sums = array(size_16, summed)
    known = array(size_16, lambda *_: [0] * model.L)  # K
    batches: list[list[int]] = []
    for p in range(3):
        blocks = [
            (v, i, j)
            for v in range(size_16[0])
            for i in range(size_16[1])
            for j in range(size_16[2])
            if p == ((0, 2), (2, 1))[i % 2][j % 2]
        ]
        found = [
            three_layers(model, f"passes.{p}", sums[v][i][j] + beside(known, v, i, j, KNOWN[p])) for v, i, j in blocks
        ]
        of_phases = [parameters[2 * quarter * m :][: 2 * quarter] for m in range(4) for parameters in found]
        means = [value for parameters in of_phases for value in parameters[:quarter]]
        indices = [table_index(value) for parameters in of_phases for value in parameters[quarter:]]
        batches.append(take_batch(coder, model.tables, indices))
        values = [256 * symbol + mean for symbol, mean in zip(batches[-1], means, strict=True)]
        for at, (m, (v, i, j)) in enumerate((m, block) for m in range(4) for block in blocks):
            known[v][i][j][quarter * m : quarter * m + quarter] = values[at * quarter :][:quarter]
    return batches, array(size, lambda v, i, j: known[v][i // 2][j // 2][quarter * (2 * (i % 2) + j % 2) :][:quarter])


def phase_by_phase(size: Size) -> list[tuple[int, int, int, int]]:
    """Return (m, v, i, j) of all positions, in the order of a batch."""
    return [
        (m, v, i, j)
        for m in range(4)
        for v in range(size[0])
        for i in range(m >> 1, size[1], 2)
        for j in range(m % 2, size[2], 2)
    ]


def three_layers(model: Model, name: str, x: Vector, group: int = 0) -> Vector:
    for part in ("enter", "middle"):
        x = relu(apply(model.layers[f"{name}.{part}"], x, group))
    return apply(model.layers[f"{name}.leave"], x, group)


def decode_detail(weights: bytes, payload: bytes, size_8: Size) -> list[list[int]]:
    """Section 7.2: the planes, each in the order of its array."""
    tables, entropy_tables = read_detail_tables(weights), read_tables(TABLES.read_bytes())
    coder, (views, rows, columns) = Coder(payload), size_8
    positions = [(v, i, j) for v in range(views) for i in range(rows) for j in range(columns)]
    s = dict.fromkeys(positions, 0)
    planes: list[list[int]] = []
    for of_plane in tables:
        indices = list[int]()
        for v, i, j in positions:
            beside_it = [(v, i - 1, j), (v, i + 1, j), (v, i, j - 1), (v, i, j + 1)]
            c = 2 * s[v, i, j] + sum(s.get(position, 0) for position in beside_it)
            indices.append(of_plane[sum(threshold <= c for threshold in THRESHOLDS)])
        planes.append(take_batch(coder, entropy_tables, indices))
        for position, symbol in zip(positions, planes[-1], strict=True):
            s[position] += min(abs(symbol), 15)
    require(coder.state == 0 and not coder.words, "symbols and bytes do not end together")
    return planes


def digest(batches: list[list[int]]) -> bytes:
    """Section 8."""
    found = hashlib.blake2b(digest_size=8)
    for batch in batches:
        found.update(b"".join(symbol.to_bytes(4, "little", signed=True) for symbol in batch))
    return found.digest()
