"""Lumel and Cycles on one scene and one atlas: time and error of both, in the same run.

Usage : python measure.py SCENE.glb [--res 256] [--texels-per-unit X] [--quality preview]
              [--cycles-samples 64] [--no-cycles] [--count 2000] [--target 0.002] [--time 150]
              [--repeat 3] [--threads 2] [--sky R,G,B] [--light-tree] [--all] [--out DIR]
              [-- further options of `lumel bake`]
Steps : 1 bake with lumel; without --texels-per-unit, search with draft bakes for the density at
          which the scene fills one page of at most --res; 2 flatten its atlas
          (flatten_lightmap.py); 3 draw lumels two texels from chart edges (lumels.py) and compute
          their truth (truth.py --two-sided: over the whole texel, as lumel defines it, and over its
          middle half, which Cycles was measured to average); 4 bake again, lumel and Cycles in
          turn, --repeat times; 5 compute the figures of `lumel diff` for both, each with its own
          footprint (reference.py).
Output: a Markdown table (all chosen lumels; and those that are lit and have no shadow or contact
        edge, for which the treatment of a texel's buried part does not matter) and
        OUT/NAME.measure.json. References are cached under LUMEL_REF (reference.py).
Note  : Cycles treats every surface as two-sided, while in lumel, single-sided backs are black. The
        truth is two-sided, so a comparison is fair only if lit backs are not visible. This holds
        for the Cornell box (its backs are outside, and nothing there reflects light back in).
        Run nothing else at the same time: the load average is printed.
"""
import argparse
import json
import os
import statistics
import sys

import common
import cycles_peer
import reference


def fit_density(scene, directory, res, extra):
    """texels per unit at which the bake is one page of side <= res, by bisection over draft bakes"""
    low, high, x = None, None, None
    for _ in range(14):
        opts = ["--quality", "draft", "--max-page", 8 * res] + extra
        r = common.bake(scene, directory, *(opts + (["--texels-per-unit", "%.5g" % x] if x else [])))
        if r["code"] != 0:
            raise SystemExit("lumel failed (%d): %s" % (r["code"], r["err"]))
        side = max(max(common.exr_size(p)) for p in r["pages"]) * (1 if len(r["pages"]) == 1 else 2)
        x = x or r["report_json"]["layout"].get("texels_per_unit") or r["report_json"]["settings"]["texels_per_unit"] or 16.0
        if side <= res:
            low = x
            if side == res and high and high / x < 1.01:
                break
        else:
            high = x
        nxt = x * res / side if low is None or high is None else (low * high) ** 0.5
        x = nxt if nxt != x else x * (1.3 if side <= res else 0.77)
        if low and high and high / low < 1.003:
            break
    return low


def main():
    argv, further = sys.argv[1:], []
    if "--" in argv:
        i = argv.index("--")
        argv, further = argv[:i], argv[i + 1:]
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("scene")
    ap.add_argument("--res", type=int, default=256)
    ap.add_argument("--texels-per-unit", type=float)
    ap.add_argument("--quality", default="preview")
    ap.add_argument("--cycles-samples", type=int, default=64)
    ap.add_argument("--no-cycles", action="store_true")
    ap.add_argument("--light-tree", action="store_true", help="leave Cycles' light tree on (better with many lamps)")
    ap.add_argument("--count", type=int, default=2000)
    ap.add_argument("--all", action="store_true", help="every covered lumel, chart edges too")
    ap.add_argument("--target", type=float, default=0.002)
    ap.add_argument("--time", type=float, default=150)
    ap.add_argument("--repeat", type=int, default=3)
    ap.add_argument("--threads", type=int, default=os.cpu_count())
    ap.add_argument("--sky", default="0,0,0")
    ap.add_argument("--out", default="/tmp/lumel-measure")
    a = ap.parse_args(argv)
    name = os.path.splitext(os.path.basename(a.scene))[0]
    out = os.path.join(a.out, name)
    extra = ["--threads", a.threads] + further + (["--sky", a.sky] if a.sky != "0,0,0" else [])
    density = a.texels_per_unit or fit_density(a.scene, out + ".fit", a.res, extra)
    options = ["--quality", a.quality, "--texels-per-unit", "%.5g" % density, "--max-page", 8 * a.res] + extra
    bakes = [common.bake(a.scene, out, *common.COMPARABLE, *options)]
    if bakes[0]["code"] != 0:
        raise SystemExit(bakes[0]["err"])
    flat = out + ".flat.glb"
    side = reference.flatten(bakes[0]["glb"], flat)["res"]
    if len(bakes[0]["pages"]) != 1:
        print("warning: %d pages; only page 0 is measured" % len(bakes[0]["pages"]), file=sys.stderr)
    if not a.no_cycles and not cycles_peer.available():
        print("warning: no module bpy in this Python: Cycles is left out; tools/setup.sh installs it", file=sys.stderr)
        a.no_cycles = True
    refs = reference.References(name, flat, side, a.count, a.target, a.time, a.sky, log=lambda s: print(s, file=sys.stderr))
    whole, half = [reference.load(refs.truth(footprint, every=a.all)) for footprint in (1.0, 0.5)]

    def rows_of(mine, other, exr):
        """figures over all chosen lumels, and over those that are lit and have no shadow or
        contact edge"""
        on = refs.reflecting(mine)
        return reference.errors(mine, exr, on), reference.errors(mine, exr, reference.clear(mine, other) & on)

    load = os.getloadavg()[0]
    peers, process = [], []
    for _ in range(a.repeat):
        bakes.append(common.bake(a.scene, out, *common.COMPARABLE, *options))
        if not a.no_cycles:
            peers.append(cycles_peer.bake(flat, out + ".cycles", side, a.cycles_samples, a.threads, a.sky, light_tree=a.light_tree))
    timed = bakes[1:] if a.repeat else bakes
    reports = [b["report_json"] for b in timed]
    seconds = [r["measured"]["seconds"] for r in reports]
    rows = [("lumel %s" % a.quality, statistics.median(seconds), [b["seconds"] for b in timed],
             max(b["peak_mb"] for b in timed), *rows_of(whole, half, bakes[0]["pages"][0]))]
    if peers:
        rows.append(("Cycles %d samples" % a.cycles_samples, statistics.median(p["bake_s"] for p in peers), [p["process_s"] for p in peers],
                     max(p["peak_rss_mb"] for p in peers), *rows_of(half, whole, peers[0]["map"])))
    print("%s, %d² page, %.4g texels per unit, %d threads, load average %.2f, %d runs in turn\n" % (name, side, density, a.threads, load, a.repeat))
    print("| | bake s (median) | process s | peak MB | lumels | relRMSE | p50 | p95 | p99 | bias | truth's own |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for label, s, wall, mb, every, lit in rows:
        for kind, c in (("all", every), ("lit, no edge: %d of %d" % (lit["n"], every["n"]), lit)):
            print("| %s | %.2f | %.2f | %.0f | %s | %.2f %% | %.2f %% | %.2f %% | %.2f %% | %+.2f %% | %.2f %% |" % (
                label, s, statistics.median(wall), mb, kind, 100 * c["relRMSE"], 100 * c["p50"], 100 * c["p95"], 100 * c["p99"], 100 * c["bias"], 100 * c["own"]))
    print("\nphases (last run): " + ", ".join("%s %.2f" % kv for kv in common.phases(reports[-1]).items()))
    result = dict(scene=name, res=side, texels_per_unit=density, quality=a.quality, threads=a.threads, load=load, runs=seconds,
                  peer_runs=[p["bake_s"] for p in peers], rows=[dict(label=r[0], bake_s=r[1], process_s=r[2], peak_mb=r[3], all=r[4], clear=r[5]) for r in rows], phases=common.phases(reports[-1]))
    json.dump(result, open(out + ".measure.json", "w"), indent=1)


if __name__ == "__main__":
    main()
