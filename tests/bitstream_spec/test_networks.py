"""FORMAT.md, section 9.3, names the graphs that define the networks of every shipped model."""

import hashlib
import re

import pytest

from fecocodec.model_files import GRAPHS_FOLDER, RECEIVER_FILE, SHIPPED, model_id_of
from tests.bitstream_spec.test_second_reader import SPECIFICATION

MODELS = sorted(path.parent.parent.name for path in SHIPPED.glob(f"*/{GRAPHS_FOLDER}/update.onnx"))


def listed(model: str) -> tuple[str, dict[str, str]]:
    """Return the model id and the SHA-256 of each graph, as FORMAT.md has them."""
    text = (SPECIFICATION / "FORMAT.md").read_text().split("### 9.3 ")[1].split("## 10. ")[0]
    model_id, table = re.search(rf"Graphs of `{model}`, model id `(\w+)`.*?\n\n(.+?)\n\n", text, re.DOTALL).groups()  # type: ignore[union-attr]
    return model_id, dict(re.findall(r"^\| `(\w+)` \|.*\| `(\w{64})` \|$", table, re.MULTILINE))


@pytest.mark.parametrize("model", MODELS)
def test_the_graphs_of_a_model_are_those_of_the_specification(model: str) -> None:
    """After `make graphs`, their hashes are copied to FORMAT.md, section 9.3."""
    graphs = (SHIPPED / model / GRAPHS_FOLDER).glob("*.onnx")
    found = {path.stem: hashlib.sha256(path.read_bytes()).hexdigest() for path in graphs}
    assert listed(model) == (model_id_of((SHIPPED / model / RECEIVER_FILE).read_bytes()).hex(), found)


def test_every_model_is_found() -> None:
    assert "compact-6" in MODELS
