"""Without Dask, the message names the extra to install."""

import pytest

from fecocodec.batch import cluster_extra
from fecocodec.errors import InputError


def test_a_missing_extra_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster_extra, "find_spec", lambda _name: None)
    with pytest.raises(InputError) as caught:
        cluster_extra.require_cluster_extra()
    assert str(caught.value) == (
        "several processes need the package distributed; run `pip install '.[cluster]'` in the project's folder, or "
        "use one process by `workers=1`."
    )
