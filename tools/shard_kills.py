#!/usr/bin/env python3
"""Kills `lumel gather` at random moments, starts it again, and compares the merged bake with a plain one.

    tools/shard_kills.py [--kills 50] [--shards 3] [--level GLB] [-- bake options]

Each shard is killed again and again (SIGKILL, after a random share of the time that it takes) until all kills are
used; then it may end. Nothing but whole shards may be in the work folder afterwards. LUMEL names the program
(common.py). Exit code 1 if a byte differs."""
import argparse
import filecmp
import os
import random
import signal
import subprocess
import sys
import tempfile
import time

import common


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    here = os.path.dirname(os.path.abspath(__file__))
    p.add_argument("--level", default=os.path.join(here, "../assets/demo_level.glb"))
    p.add_argument("--kills", type=int, default=50)
    p.add_argument("--shards", type=int, default=3)
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("options", nargs="*")
    a = p.parse_args()
    options = a.options or ["--quality", "draft", "--texels-per-unit", "3", "--sky", "0.3"]
    chance, lumel = random.Random(a.seed), common.LUMEL
    with tempfile.TemporaryDirectory() as t:
        plain, work, out = (os.path.join(t, name) for name in ("plain", "work", "out"))
        run = lambda *args: subprocess.run([lumel, *args, "-q"], check=True)  # noqa: E731
        run("bake", a.level, "-o", plain, "--no-config", *options)
        run("solve", a.level, "-o", work, "--no-config", *options)
        gather = lambda k: [lumel, "gather", work, "-q", "--shard", f"{k}/{a.shards}"]  # noqa: E731
        start = time.time()
        run("gather", work, "--shard", f"1/{a.shards}")
        takes = time.time() - start
        os.remove(os.path.join(work, f"shard-1-of-{a.shards}.light"))
        killed = ended = 0
        for kill in range(a.kills):
            child = subprocess.Popen(gather(1 + kill % a.shards))
            try:
                child.wait(chance.random() * takes)
                ended += 1
                os.remove(os.path.join(work, f"shard-{1 + kill % a.shards}-of-{a.shards}.light"))
            except subprocess.TimeoutExpired:
                child.send_signal(signal.SIGKILL)
                child.wait()
                killed += 1
        for k in range(1, a.shards + 1):
            subprocess.run(gather(k), check=True)
        run("merge", work, "-o", out)
        names = [n for n in sorted(os.listdir(plain)) if not n.endswith(".report.json")]
        differ = [n for n in names if not filecmp.cmp(os.path.join(plain, n), os.path.join(out, n), shallow=False)]
        left = [n for n in os.listdir(work) if n.startswith(".lumel")]
    print(f"{killed} kills, {ended} shards had ended before; {len(names)} files equal"
          if not differ else f"these differ: {differ}")
    print(f"temporary files left in the work folder: {len(left)}")
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())
