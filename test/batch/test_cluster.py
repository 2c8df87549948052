"""The same batch on a Dask cluster."""

import os
import sys
import time

import cv2
import pytest

from rsmb_ros.batch.batch import Batch, BatchJob
from rsmb_ros.batch.cluster import ClusterCrew
from rsmb_ros.batch.items import Item
from rsmb_ros.batch.tasks import Task, carried_out
from rsmb_ros.core.errors import RsmbError
from rsmb_ros.replay.job import ReplayJob, replay

distributed = pytest.importorskip('distributed')
DEADLINE_S = 60.0


@pytest.fixture(scope='module')
def cluster():
    """Two workers with a thread each, in this process."""
    threads = cv2.getNumThreads()
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=False,
        protocol='tcp',
        host='127.0.0.1',
        scheduler_port=0,
        dashboard_address=':0',
        silence_logs=50,
    ) as made:
        yield made
    cv2.setNumThreads(threads)


def test_outputs_are_those_of_replay(cluster, rsmb, write_bag, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bags = [write_bag(tmp_path / f'{n}.mcap', n) for n in range(3)]
    bags[1].write_bytes(b'no bag')
    names = [bag.name for bag in bags]
    options = ['--scheduler', cluster.scheduler_address, '--csv']
    code, lines, err = rsmb('batch', *names, '-o', 'out', *options)
    assert code == 1
    assert '3 recordings: 2 done, 1 failed' in lines[-1]
    assert err[0].startswith(f'rsmb: error: 1: failed: {bags[1]}: ')
    assert err[0].endswith(f' (on {os.uname().nodename})')
    for n in (0, 2):
        replay(ReplayJob(bags[n], tmp_path / 'r.mcap', csv=tmp_path / 'r.csv'))
        for end in ('mcap', 'csv'):
            assert (tmp_path / 'out' / f'{n}.{end}').read_bytes() == (
                tmp_path / f'r.{end}'
            ).read_bytes()


def test_stopped_batch_stops_the_workers(cluster, write_bag, tmp_path):
    frames = 300
    bag = write_bag(tmp_path / 'long.mcap', 1, frames)
    (tmp_path / 'out').mkdir()
    table = tmp_path / 'out' / 'long.csv'
    batch = Batch(BatchJob([Item(bag)], tmp_path / 'out', beside=['csv']))

    def interrupt():
        if table.exists() and len(table.read_text().splitlines()) > 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(batch.run(ClusterCrew(cluster.scheduler_address), interrupt))
    end = time.monotonic() + DEADLINE_S
    while any(worker.state.executing_count for worker in cluster.workers.values()):
        assert time.monotonic() < end, 'the worker goes on'
        time.sleep(0.05)
    assert len(table.read_text().splitlines()) < frames
    assert batch._manifest.get('long').status == 'pending'


def test_folder_that_a_worker_does_not_see_is_told(cluster, write_bag, tmp_path):
    bag = write_bag(tmp_path / 'a.mcap', 1)
    folder = tmp_path / 'out'
    folder.mkdir()
    batch = Batch(BatchJob([Item(bag)], folder))
    task = batch._task(batch.to_do[0])
    folder.rmdir()
    with ClusterCrew(cluster.scheduler_address) as crew:
        (outcome,) = crew.results([task], lambda: None)
    assert outcome.reason.startswith(f'{folder}: is not there on ')


def test_failure_of_a_worker_is_told_and_the_others_go_on(
    cluster, write_bag, tmp_path, monkeypatch
):
    def dying(task):
        if task.name == '0':
            raise MemoryError('of the\nworker')
        return carried_out(task)

    monkeypatch.setattr('rsmb_ros.batch.cluster.in_worker', dying)
    bags = [write_bag(tmp_path / f'{n}.mcap', n) for n in range(2)]
    (tmp_path / 'out').mkdir()
    batch = Batch(BatchJob([Item(bag) for bag in bags], tmp_path / 'out'))
    ended = {e.name: e for e in batch.run(ClusterCrew(cluster.scheduler_address), lambda: None)}
    assert ended['0'].reason == 'the worker failed: MemoryError: of the worker'
    assert ended['1'].status == 'done'


def test_cluster_that_loses_its_workers_is_told(cluster, monkeypatch):
    monkeypatch.setattr('rsmb_ros.batch.cluster.ALONE_S', 0.1)
    with ClusterCrew(cluster.scheduler_address) as crew:
        monkeypatch.setattr(crew._client, 'nthreads', dict)
        with pytest.raises(RsmbError, match=r'no worker for 0\.1 s; what was finished is kept'):
            list(crew.results([Task('a', {}, '0')], lambda: None))


def test_missing_scheduler_is_told(rsmb, tmp_path, monkeypatch):
    monkeypatch.setattr('rsmb_ros.batch.cluster.CONNECT_S', 0.5)
    code, _, err = rsmb('batch', 'a.bag', '-o', tmp_path, '--scheduler', 'tcp://127.0.0.1:9')
    assert code == 1
    assert '--scheduler tcp://127.0.0.1:9: no Dask scheduler answers there' in err[-1]
    code, _, err = rsmb('batch', 'a.bag', '-o', tmp_path, '--scheduler', 'what://ever')
    assert code == 1
    assert 'must be tcp://HOST:PORT' in err[-1]


def test_cluster_without_workers_is_told(rsmb, tmp_path, monkeypatch):
    monkeypatch.setattr('rsmb_ros.batch.cluster.WORKER_S', 0.5)
    with distributed.LocalCluster(
        n_workers=0,
        processes=False,
        protocol='tcp',
        host='127.0.0.1',
        scheduler_port=0,
        dashboard_address=':0',
    ) as empty:
        address = empty.scheduler_address
        code, _, err = rsmb('batch', 'a.bag', '-o', tmp_path, '--scheduler', address)
    assert code == 1
    assert f'no worker within 0.5 s; start some with `dask worker {address}' in err[-1]


def test_missing_dask_is_told(rsmb, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    code, _, err = rsmb('batch', 'a.bag', '-o', tmp_path, '--scheduler', 'tcp://127.0.0.1:9')
    assert code == 1
    assert "pip install 'rsmb_ros[batch]'" in err[-1]
