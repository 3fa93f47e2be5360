"""Times Embree's single rays, on the triangles and rays that `examples/compare.rs` writes.

    pip install embreex numpy
    cargo run --release -p lumel-visibility --example compare - 1 DIR
    python embree.py DIR

Processor time of one thread, the best of five, M rays/s.
"""
import sys
import time

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

folder = sys.argv[1]
triangles = np.fromfile(f"{folder}/triangles.f32", "<f4").reshape(-1, 3, 3)
rays = np.fromfile(f"{folder}/rays.f32", "<f4").reshape(-1, 6)
origins, directions = (np.ascontiguousarray(rays[:, i : i + 3]) for i in (0, 3))

for robust in (False, True):
    scene = rtcore_scene.EmbreeScene(robust=robust)
    mesh = TriangleMesh(scene, triangles)
    scene.run(origins[:10], directions[:10])
    for query in ("INTERSECT", "OCCLUDED"):
        best = float("inf")
        for _ in range(5):
            start = time.thread_time()
            hits = scene.run(origins, directions, query=query)
            best = min(best, time.thread_time() - start)
        rate = len(rays) / best / 1e6
        print(f"Embree {'robust' if robust else 'default'} {query} {rate:.2f} M rays/s ({(hits >= 0).sum()} hit)")
