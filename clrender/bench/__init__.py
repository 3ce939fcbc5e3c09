"""Benchmark of clrender against other renderers: the same scenes, interleaved runs, and ratios."""

from clrender.bench.measure import Run, measure, summary
from clrender.bench.peers import PEERS, Peer, peer_from
from clrender.bench.scenes import SCENES, write_scene

__all__ = ["PEERS", "SCENES", "Peer", "Run", "measure", "peer_from", "summary", "write_scene"]
