"""Rendering of units on the workers of a Dask cluster. It needs the extra `cluster`.

with clrender.cluster.open_cluster("tcp://host:8786") as cluster, clrender.Session() as session:
    image = session.render(scene, spp=4096, cluster=cluster)
"""

from clrender.cluster.address import check_address
from clrender.cluster.dask_cluster import DaskCluster, open_cluster

__all__ = ["DaskCluster", "check_address", "open_cluster"]
