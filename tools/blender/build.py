"""Packs the add-on into a zip that Blender can install (Preferences > Get Extensions > Install from
Disk).

    python tools/blender/build.py [OUT.zip]

The same files give the same bytes.
"""

import os
import sys
import zipfile

SOURCE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "lumel")
# The earliest time that a zip can store.
TIME = (1980, 1, 1, 0, 0, 0)


def build(out):
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as z:
        for name in sorted(os.listdir(SOURCE)):
            if not name.endswith((".py", ".toml")):
                continue
            info = zipfile.ZipInfo(name, TIME)
            info.compress_type, info.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            with open(os.path.join(SOURCE, name), "rb") as f:
                z.writestr(info, f.read())


if __name__ == "__main__":
    path = sys.argv[1] if len(sys.argv) > 1 else "lumel-blender.zip"
    build(path)
    print(path)
