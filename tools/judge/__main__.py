"""Judges bakes of levels by what people see: see tools/judge/README.md for what each figure is.

python tools/judge truth --levels DIR --out OUT
python tools/judge bake  --levels DIR --out OUT --binary LUMEL [--label before]
                         [--quality draft --quality preview ...]
python tools/judge table --out OUT [--seeds odd] [--label before --label after]
python tools/judge sheet --out OUT --label after [--quality preview]
python tools/judge page  --out OUT --label after [--docs DIR]
python tools/judge cameras LEVEL --levels DIR --view EYE:TARGET ... [--sky R,G,B] [--sun X,Y,Z,LUX]
python tools/judge cameras LEVEL --levels DIR --auto 4 [--seed N]
"""
import argparse
import os
import sys

if __package__ in (None, ""):
    sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    import judge            # noqa: F401
    __package__ = "judge"

LAB = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "lab")
QUALITIES = ["draft", "quick", "preview", "production"]


def main():
    p = argparse.ArgumentParser(description=__doc__,
                                formatter_class=argparse.RawDescriptionHelpFormatter)
    sub = p.add_subparsers(dest="command", required=True)
    for name in ("truth", "bake", "table", "sheet", "page"):
        c = sub.add_parser(name)
        c.add_argument("--out", required=True, help="folder of figures, pictures and references")
        c.add_argument("--seeds", choices=["odd", "even", "all"], default="all",
                       help="even seeds are for work, odd ones for figures that are quoted")
        c.add_argument("--family", action="append", default=[])
        if name in ("truth", "bake"):
            c.add_argument("--levels", required=True)
            c.add_argument("--width", type=int, default=480, help="of the pictures, pixels")
            c.add_argument("--paths", type=int, default=16, help="a subpixel, four to a pixel")
        if name == "bake":
            c.add_argument("--binary", required=True)
            c.add_argument("--timeout", type=float, default=600, help="seconds a bake")
            c.add_argument("--option", action="append", default=[], help="for lumel bake")
        if name != "truth":
            c.add_argument("--quality", action="append", default=[], choices=QUALITIES)
            c.add_argument("--label", **(dict(default="") if name == "bake" else
                                         dict(action="append", default=[])))
        if name in ("sheet", "page"):
            c.add_argument("--count", type=int, default=12, help="crops of a family")
        if name == "page":
            c.add_argument("--docs", default=LAB, help="folder of tables/unseen_levels.md and its pictures")
    c = sub.add_parser("cameras", help="copy a level into DIR with views")
    c.add_argument("level")
    c.add_argument("--levels", required=True)
    c.add_argument("--view", action="append", default=[], help="x,y,z:x,y,z, metres")
    c.add_argument("--auto", type=int, default=0, help="so many views from where one could stand")
    c.add_argument("--seed", type=int, default=0, help="draws other views")
    c.add_argument("--fov", type=float, default=60, help="vertical, degrees")
    c.add_argument("--sky", help="radiance, r,g,b")
    c.add_argument("--sun", help="x,y,z,lux[,degrees]: direction of its light, size of its disc")
    a = p.parse_args()
    if a.command == "truth":
        from . import runs, truth
        for _, _, path in runs.levels(a.levels, a.seeds, a.family):
            try:
                truth.references(path, os.path.join(a.out, "truth"), a.width, a.paths)
            except truth.scenes.Unsupported as problem:
                print("%s: %s" % (path, problem))
    elif a.command == "cameras":
        from . import cameras
        if a.auto:
            from . import places
            a.view += places.find(a.level, a.auto, a.seed)
        if not a.view:
            p.error("cameras: --view or --auto")
        print("\n".join("--view=" + view for view in a.view))
        cameras.place(a.level, a.levels, a.view, a.fov, a.sky, a.sun)
    elif a.command == "bake":
        from . import runs
        a.quality = a.quality or ["preview"]
        runs.bake_all(a)
    else:
        from . import table, sheet
        {"table": table.main, "sheet": sheet.main, "page": sheet.page}[a.command](a)


main()
