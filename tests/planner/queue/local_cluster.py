"""A Dask cluster on this machine's loopback address, for tests."""

from __future__ import annotations

from collections.abc import Callable

from distributed import LocalCluster

from microplan.planner.queue.cluster import ClusterQueue


def local_cluster(workers: int) -> LocalCluster:
    """Return a scheduler with workers of one thread each, in processes."""
    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address=None,
        memory_limit=0,
        silence_logs=50,
    )


def local_queue(workers: int) -> tuple[ClusterQueue, Callable[[], None]]:
    """Return a queue of a new cluster, and what ends the cluster."""
    cluster = local_cluster(workers)
    return ClusterQueue(cluster.scheduler_address), cluster.close
