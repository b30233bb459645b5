"""Batches on Dask workers: processes that are killed, and schedulers that do not answer."""

import os
from collections import Counter
from pathlib import Path

import pytest
import torch

pytest.importorskip("distributed", reason="the extra `cluster` is not installed")

import dask

import fecocodec
from fecocodec.batch import cluster
from fecocodec.batch.cluster import connected_cluster, local_cluster
from fecocodec.batch.run import run_batch
from fecocodec.batch.scenes import scene_folders
from fecocodec.codec.options import EncodingOptions
from fecocodec.errors import InputError
from tests.batch.encoding_works import EncodeAndDie
from tests.batch.works import Reverse
from tests.example_scenes import MODEL


@pytest.mark.timeout(300)
def test_scenes_of_a_killed_worker_end_once(texts, output: Path) -> None:
    content = {f"s{number:02d}": f"text {number}" for number in range(12)} | {"s03": "kill once", "s07": "bad"}
    scenes = texts(**content)
    with local_cluster(2) as local, connected_cluster(local.client.scheduler.address) as engine:
        workers = set(engine.client.run(os.getpid).values())
        outcomes = list(run_batch(scenes, output, Reverse(), engine))
    killed = int((scenes[0].path.parent / "s03.killed").read_text())
    assert len(workers) == 2 and killed in workers
    assert Counter(of.scene for of in outcomes) == Counter(content.keys())
    assert {of.scene for of in outcomes if of.status != "done"} == {"s07"}
    for name, text in content.items():
        if name != "s07":
            assert (output / f"{name}.rev").read_bytes() == text[::-1].encode()
    assert len(list(output.iterdir())) == 2 * len(content) - 1


@pytest.mark.timeout(300)
def test_a_scene_that_kills_its_workers_fails_and_the_others_end(texts, output: Path) -> None:
    scenes = texts(a="abc", b="kill", c="def")
    with dask.config.set({"distributed.scheduler.allowed-failures": 1}), local_cluster(1) as engine:
        outcomes = {of.scene: of for of in run_batch(scenes, output, Reverse(), engine)}
    assert {name: of.status for name, of in outcomes.items()} == {"a": "done", "b": "failed", "c": "done"}
    assert outcomes["b"].error == (
        f"{scenes[1].path}: the processes that worked on it were killed; check the memory, or give fewer or smaller "
        "views."
    )
    assert outcomes["b"].error == next(run_batch(scenes[1:], output, Reverse())).error  # not tried again


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_files_of_workers_equal_single_encodings(photographed: Path, random_weights: Path, output: Path) -> None:
    model = random_weights / MODEL
    scenes = scene_folders(photographed)
    options = EncodingOptions(effort="fast", model=str(model), is_measured=False)  # measured, it may drop stage 2
    work = EncodeAndDie(options, dying="scene_1")
    with local_cluster(2) as engine:
        workers = set(engine.client.run(os.getpid).values())
        outcomes = list(run_batch(scenes, output, work, engine))
    assert int((photographed.parent / "killed").read_text()) in workers
    assert sorted((of.scene, of.status) for of in outcomes) == [(scene.name, "done") for scene in scenes]
    num_threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        for scene in scenes:
            expected = fecocodec.encode(fecocodec.read_views(scene.path), effort="fast", model=model)
            assert (output / f"{scene.name}.fcs").read_bytes() == expected
    finally:
        torch.set_num_threads(num_threads)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense", "tcp://[::"])
def test_a_scheduler_that_does_not_answer_is_one_sentence(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "SECONDS_TO_ANSWER", 1)
    with pytest.raises(InputError) as caught, connected_cluster(address):
        pass
    assert str(caught.value) == (
        f"scheduler {address}: it does not answer within 1 s; start `dask scheduler`, or correct the address."
    )
