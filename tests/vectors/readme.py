"""Generate the README of the vectors, with one line per file."""

from typing import Any

_HEAD = """# Test vectors

Made by `make vectors`; do not edit. `valid/scene-*.fcs` are scenes of released models, and `valid/paper.fcs` has the
whole model in `paper/`, of the method `paper`. All others use the entropy model and the detail in `tiny.safetensors`
(ENTROPY.md, section 6.1). The numbers of both were drawn once and never change. `expected.json` says what a reader
must find:

| field | meaning |
|---|---|
| `sha256` | of the file |
| `cameras` | of near, far, then fx fy cx cy and the rows of camera-to-world of each view, little-endian float32 |
| `coverage` | of the bits of the cells, or null |
| `fading` | of the levels of the blocks, or null |
| `detail` / `symbols` | of symbols by plane, view, row, column, little-endian int64; `detail` may be null |
| `stages` / `symbols` | one for each of the seven batches: of its symbols in their order, little-endian int64 |
| `stages` / `z_hat`, `y_hat` | of values in Q8, clipped to +-2^24, by view, row, column, channel, little-endian int64 |
| `rule` | of a faulty stream: that of FORMAT.md, section 12, or ENTROPY.md, section 9 |
| `says` | what the product's message contains |

Fingerprints of values are the first 16 hexadecimal digits of their SHA-256.

`valid/*.f32` hold the first Gaussian that FORMAT.md, section 9.1, makes of their stream, and every sixteenth after it.
Other machines must come close to them (FORMAT.md, section 15). A row has 23 little-endian float32 values, or 38 in
`paper.f32`: centre, three standard deviations, rotation, opacity, then red, green and blue of each coefficient.
Coefficients that a stream does not have are 0. A Gaussian more or less shifts all later rows.
"""


def readme(expected: dict[str, Any]) -> str:
    lines = [_HEAD]
    for folder in ("valid", "uncommon"):
        lines += [f"\n## {folder}/\n\n| file | what it breaks |\n|---|---|\n"]
        lines += [
            f"| {name.partition('/')[2]} | {entry['breaks']} |\n"
            for name, entry in expected["good"].items()
            if name.startswith(folder)
        ]
    lines += ["\n## faulty/\n\n| file | the rule it breaks |\n|---|---|\n"]
    lines += [f"| {name.partition('/')[2]} | {entry['rule']} |\n" for name, entry in expected["faulty"].items()]
    return "".join(lines)
