"""The formats of decoded Gaussians, one entry each. No NumPy.

Writing, `--help`, refusals and the table of docs/output_formats.md follow from FORMATS. To add a format, write a file
of this folder with a function `file_bytes(scene: OutputScene) -> bytes`, and add its entry.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Frame = Literal["input", "first-camera", "upright"]
SpzVersion = Literal[3, 4]
RDF = "those of the input cameras"
RUB = "RUB: `.ply` with y and z negated"


@dataclass(frozen=True)
class OutputFormat:
    """An output format.

    ending: of file names, in lower case, with its dot. module: name of the file of this folder that writes it.
    title: for `--help`. contents, precision, axes: cells of the table in docs/output_formats.md.
    may_be_empty: whether a file can hold no Gaussians. sh_degree: degree of the harmonics unless another one is asked
    for, with zeros above that of the Gaussians; 0 for their own degree. frame: unless another one is asked for.
    """

    ending: str
    module: str
    title: str
    contents: str
    precision: str
    axes: str
    may_be_empty: bool = False
    sh_degree: int = 0
    frame: Frame = "input"


PLY = OutputFormat(
    ".ply",
    "ply_writing",
    "3DGS",
    "layout of the 3DGS reference, float32",
    "exact",
    RDF,
    may_be_empty=True,
    sh_degree=3,  # which the reference and loaders after it demand; all others take it
)
FORMATS = (
    PLY,
    OutputFormat(
        ".compressed.ply",
        "compressed_ply",
        "PlayCanvas",
        "PlayCanvas, SuperSplat; 25 bytes a Gaussian",
        "11, 10, 11 bits per axis in blocks of 256",
        RDF,
    ),
    OutputFormat(
        ".spz",
        "spz",
        "Niantic",
        "Niantic SPZ, version 3 or 4",
        "24 bits per axis, as many fractional bits as the extent allows",
        RUB,
    ),
    OutputFormat(
        ".sog",
        "sog",
        "PlayCanvas",
        "PlayCanvas SOG 2: lossless WebP images in a ZIP",
        "16 bits per axis, logarithmic; palette for harmonics",
        RDF,
    ),
    OutputFormat(
        ".glb",
        "glb",
        "glTF, KHR_gaussian_splatting",
        "glTF 2.0 with `KHR_gaussian_splatting`, float32, and the coded cameras",
        "exact",
        RUB,
        frame="upright",  # glTF defines which way is up
    ),
    OutputFormat(
        ".html",
        "html_page",
        "a page that shows the scene",
        "a page that shows the scene, with the Gaussians as SPZ 3",
        "as `.spz`",
        "",
        frame="upright",
    ),
)
ENDINGS = tuple(of.ending for of in FORMATS)


def format_of(path: Path) -> OutputFormat:
    """Return the format whose ending the name of a file has, the longest one; PLY for another ending."""
    named = [of for of in FORMATS if path.name.lower().endswith(of.ending)]
    return max(named, key=lambda of: len(of.ending), default=PLY)


def table_of_formats() -> str:
    """Return the table of docs/output_formats.md."""
    head = "| ending | contents | precision | axes | frame |\n|---|---|---|---|---|\n"
    rows = (f"| `{of.ending}` | {of.contents} | {of.precision} | {of.axes} | {of.frame} |\n" for of in FORMATS)
    return head + "".join(rows)
