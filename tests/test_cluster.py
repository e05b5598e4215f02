"""Jobs on a Dask cluster: the same results as elsewhere, and what is said where there is none."""

import gc
import os
import subprocess
import sys
from pathlib import Path

import job_functions
import pytest
from job_functions import JOBS, as_text

import gvp_lib
from gvp_lib import jobs
from gvp_lib.errors import ClusterError, MissingExtraError, WorkerDiedError
from gvp_lib.jobs import dask_cluster, run_jobs

pytestmark = pytest.mark.full  # each cluster is several processes

HERE = Path(__file__).parent


def local_cluster(**options):
    from distributed import LocalCluster  # a second that collecting the tests need not wait

    return LocalCluster(**{"n_workers": 1, "threads_per_worker": 1, "dashboard_address": ":0", **options})


@pytest.fixture(scope="module", autouse=True)
def importable():
    """What workers that are started meanwhile import."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), str(HERE.parent), os.environ.get("PYTHONPATH", "")]))
        yield


@pytest.fixture(autouse=True)
def no_garbage():
    """Clients that could not connect are closed here: in the thread of the next client's loop they would block it."""
    yield
    gc.collect()


@pytest.fixture(scope="module")
def address(importable):
    """Of a cluster of two processes."""
    with local_cluster(n_workers=2, processes=True) as two:
        yield two.scheduler_address


def run(function, address, jobs=JOBS, **options):
    with dask_cluster(address) as executor:
        return run_jobs(function, jobs, executor=executor, progress=False, **options)


def test_a_cluster_gives_the_results_of_this_process_and_a_job_that_fails_stops_no_other(address):
    assert as_text(run(job_functions.draw, address)) == as_text(run_jobs(job_functions.draw, JOBS, progress=False))
    results = run(job_functions.fail_on_three, address)
    assert [key for key, result in results.items() if result.failed] == ["job 3"]
    assert "ValueError: three is too many" in results["job 3"].error


def test_jobs_run_on_the_workers_each_time_that_they_are_asked_for(address, tmp_path):
    for _ in range(2):
        done = run(job_functions.counted_pid, address, {"a": str(tmp_path / "x")})
        assert done["a"].value != os.getpid()
    assert (tmp_path / "x").read_text() == "xx"


def test_a_job_that_its_workers_die_of_fails_and_the_others_go_on():
    # Five, since four die of it, and none of them need come back: Dask starts no worker anew that dies so early that
    # the process which minds it has not heard yet of its start.
    with local_cluster(n_workers=5, processes=True) as five:
        results = run(job_functions.die_on_three, five.scheduler_address, {"a": 1, "dies": 3, "b": 2})
    assert "all those workers died while running it" in results["dies"].error
    assert not results["b"].failed


def test_a_cluster_that_ends_is_an_error_that_says_how_to_go_on_and_another_goes_on(address, tmp_path):
    one, jobs = local_cluster(processes=True), {f"job {n}": n for n in range(400)}
    kept = {"journal": tmp_path / "journal", "recipe": 1}

    def end(key, result):
        if key == "job 20":
            one.close()

    with pytest.raises(
        WorkerDiedError, match=r"its cluster ended or is cut off\. .* of 400 jobs are done\. They are in"
    ):
        run(job_functions.slow_draw, one.scheduler_address, jobs, on_result=end, **kept)
    known, heard = len((tmp_path / "journal").read_text().splitlines()) - 1, list[str]()
    assert known > 20
    again = run(job_functions.draw, address, jobs, on_result=lambda key, _: heard.append(key), **kept)
    assert len(heard) == 400 - known
    assert as_text(again) == as_text(run_jobs(job_functions.draw, jobs, progress=False))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("tcp://127.0.0.1:1", "no Dask scheduler answers at 'tcp://127.0.0.1:1'.*`dask scheduler` starts"),
        ("", "an empty one"),
        ("host", "like tcp://host:8786"),
        ("http://host:80", "like tcp://host:8786"),
        ("tcp://127.0.0.1:port", "like tcp://host:8786"),
        ("tcp://127.0.0.1:99999", "like tcp://host:8786"),
    ],
)
def test_an_address_where_nobody_answers_or_that_is_none_is_named(given, message):
    with pytest.raises(ClusterError, match=message):
        dask_cluster(given, timeout=0.5).__enter__()


@pytest.mark.parametrize(
    ("options", "timeout", "message"),
    [
        ({"threads_per_worker": 2}, 20, r"1 of 1 workers .* with 2; .*Start them by `dask worker --nthreads 1"),
        ({"n_workers": 0}, 1, r"has no workers\. Start them by"),
    ],
)
def test_a_cluster_of_other_workers_is_refused(options, timeout, message):
    with (
        local_cluster(processes=False, protocol="tcp", **options) as other,
        pytest.raises(ClusterError, match=message),
    ):
        dask_cluster(other.scheduler_address, timeout=timeout).__enter__()


def test_workers_that_would_compute_with_other_code_are_refused(address, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(jobs, "source_commit", lambda: "another")
        with pytest.raises(ClusterError, match=r"would compute with other code: commit .+, here another\. Install the"):
            dask_cluster(address).__enter__()
    monkeypatch.setattr(jobs.metadata, "version", lambda package: "0.0.9")
    with pytest.raises(ClusterError, match=rf"gvp_lib {gvp_lib.__version__}, here 0\.0\.9"):
        dask_cluster(address).__enter__()


def test_a_worker_without_the_library_is_refused(tmp_path, monkeypatch):
    """A package of the same name stands before it on the worker's path."""
    (tmp_path / "gvp_lib").mkdir()
    (tmp_path / "gvp_lib" / "__init__.py").touch()
    monkeypatch.chdir(tmp_path)
    command = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    with local_cluster(n_workers=0) as none:
        environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
        worker = subprocess.Popen([*command, none.scheduler_address], env=environment, stderr=subprocess.DEVNULL)
        try:
            with pytest.raises(ClusterError, match=r"cannot use gvp_lib: .*Install the same version"):
                dask_cluster(none.scheduler_address, timeout=20).__enter__()
        finally:
            worker.kill()
            worker.wait()


def test_without_dask_the_extra_that_brings_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"a Dask cluster needs distributed.*gvp_lib\[cluster\]"):
        dask_cluster("tcp://host:8786").__enter__()
